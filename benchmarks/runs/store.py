"""The folder of a running comparison: drives are saved one by one, and packed at the end."""

from __future__ import annotations

import dataclasses
import json
import shutil
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.runs.arms import ARMS, arm_kind
from benchmarks.runs.drive_file import refuse_other_revision
from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.saved_run import RESULTS, TRACES, Archive, Run
from benchmarks.runs.settings import OLDER, Settings
from benchmarks.runs.summary import gap, summarise
from benchmarks.runs.time_optimal import Key, task_key
from benchmarks.runs.trace import Drive, RunError, Trace
from foresee.infra.atomic_file import replacing, write_whole
from foresee.infra.command_line import UsageError
from foresee.infra.environment import commit, machine, own_version
from foresee.infra.errors import one_line, shown
from foresee.infra.results_file import write_results
from foresee.infra.resumable import SETTINGS, ResumableFolder, difference
from foresee.mapping.conventions import TICK

PARTS = "parts"
"""Folder of the drives that are not packed yet."""
GROWS = ("episodes", "arms")
"""Settings that may differ when a run is continued."""
MAPS = "maps"
"""Setting of a run: the hash of each map file."""


class Store(ResumableFolder):
    """The folder of a run, locked against other runs until it is closed or the process ends.

    Args:
        out: folder of the run; made if it is missing.
        settings: settings of the run.
        weights: fingerprint of the predictor's weights; None: it has none.
        baselines: folder of an earlier run. Its drives of arms that do not use the chosen predictor
            are copied, if they would be the same with these settings.
        maps: hash of each map file and of the file of given tasks, see
            `benchmarks.runs.tasks.input_hashes`. Runs that do not name their maps are not compared
            in it; a note says so.
        levels: level λ of each arm at a risk.

    Attributes:
        episodes: results of the finished drives.
        skipped: number of an episode → reason why it has no task.
        lost: episodes and arms whose worker processes died.

    Raises:
        UsageError: if the folder holds a run with other settings, weights or levels, or of another
            revision of the planner, cannot be written, or is in use by another run; if the folder
            of the baselines holds no run, or no drive that would be the same.
        RunError: if the folder holds damaged results, and no settings to compare.
    """

    def __init__(
        self,
        out: Path,
        settings: Settings,
        weights: str | None,
        baselines: Path | None = None,
        maps: Mapping[str, str] | None = None,
        levels: Mapping[str, float] | None = None,
    ) -> None:
        self.settings = settings
        self.skipped: dict[int, str] = {}
        self.lost: list[tuple[int, str]] = []
        # Converted to JSON and back, to be compared with the settings in files.
        identity = dataclasses.asdict(settings) | {"weights": weights}
        identity |= {MAPS: maps} if maps else {}
        self._marked = json.loads(json.dumps(identity))
        adopted = None if baselines is None else self._checked(baselines)
        if not (out / SETTINGS).exists() and (out / RESULTS).exists():
            # The settings were removed: those of the results are compared. This raises if they are
            # not readable.
            write_whole(out / SETTINGS, json.dumps(Run.read(out).settings, indent=1).encode())
        # Some older runs also name the control period, which is not a setting.
        grows = (*GROWS, "dt")
        super().__init__(
            out, self._marked, grows=grows, absent=OLDER, unchecked=(MAPS,), exclusive=True
        )
        self.commit = commit()
        listed, packed = self._packed()
        self.episodes = packed + self._loose({(e.index, e.arm) for e in packed})
        revisions = [e.revision for e in self.episodes]
        refuse_other_revision(f"--out: {out}", revisions, settings.route)
        for e in self.episodes:
            if e.level is not None and e.level != (levels or {}).get(e.arm, e.level):
                raise UsageError(
                    f"--out: {out} holds drives of {e.arm} at level {e.level:g}, not "
                    f"{(levels or {})[e.arm]:g}"
                )
        lost = {(e.index, e.arm) for e in listed} - self.done()
        if lost:
            self.notes.append(
                f"{len(lost)} of {len(listed)} drives have lost their traces and are driven again"
            )
        if adopted is not None:
            if maps and MAPS not in adopted[0].settings:
                self.notes.append(f"{baselines} does not name its {MAPS}: not compared")
            self._adopt(*adopted)

    def done(self) -> set[tuple[int, str]]:
        """Return the episodes and arms that have been driven."""
        return {(e.index, e.arm) for e in self.episodes}

    def add(self, drive: Drive) -> None:
        """Save a finished drive; afterwards it survives a kill of the process."""
        self._save(drive)
        self.episodes.append(drive.result)

    def _save(self, drive: Drive) -> None:
        self.write(_part(drive.result), dataclasses.asdict(drive.result), drive.trace.arrays)

    def pack(self, t_opt: Mapping[Key, float | None] | None = None) -> dict[str, Any]:
        """Write results.json and traces.npz of all finished drives, and return the results.

        Args:
            t_opt: task → least time T_opt [s]; None: the results keep their own.
        """
        arms = self.settings.arms
        chosen = [e for e in self.episodes if self._wanted(e)]
        if t_opt is not None:
            chosen = [
                dataclasses.replace(e, t_opt=t_opt.get(task_key(e.world, e.seed, e.start, e.goal)))
                for e in chosen
            ]
        chosen.sort(key=lambda e: (e.index, arms.index(e.arm)))
        # After an interrupt, a file may belong to a drive that is not in `episodes`: it is kept.
        known = {self.folder / _part(e) for e in self.episodes}
        loose = [path for path in self._parts() if path in known]
        if loose:
            self._pack_traces(loose)
        results = {
            "settings": self._marked | {"dt": TICK},
            "machine": machine(),
            "version": own_version(),
            "commit": self.commit,
            "summary": summarise(chosen, arms),
            "gap": gap(chosen, arms, self.settings.route),
            "skipped": {str(k): v for k, v in self.skipped.items()},
            "lost": self.lost,
            "episodes": [dataclasses.asdict(e) for e in chosen],
            "unused": [dataclasses.asdict(e) for e in self.episodes if not self._wanted(e)],
        }
        write_results(self.folder / RESULTS, "comparison", results)
        for path in loose:
            path.unlink()
        return results

    def _wanted(self, episode: DriveResult) -> bool:
        return episode.index < self.settings.episodes and episode.arm in self.settings.arms

    def _checked(self, baselines: Path) -> tuple[Run, list[str]]:
        """Return an earlier run, and the arms whose drives would be the same in this run."""
        try:
            run = Run.load(baselines)
        except RunError as error:
            raise UsageError(f"--baselines: {error}") from None
        present, earlier = self._marked, run.settings
        other = {k for k, v in present.items() if k not in GROWS and v != earlier.get(k)}
        if MAPS not in earlier:
            other.discard(MAPS)
        arms = [arm for arm in self.settings.arms if not ARMS[arm_kind(arm)].has_predictor]
        if not arms:
            raise UsageError(
                "--baselines: only drives without the chosen predictor and predicted frontiers are "
                "copied, and no arm makes such drives"
            )
        alike = [arm for arm in arms if ARMS[arm_kind(arm)].drives_alike(other)]
        if not alike:
            what = ", ".join(difference(k, present, earlier) for k in present if k in other)
            raise UsageError(f"--baselines {baselines} holds a run with {what}")
        revisions = [drive.revision for drive in run.episodes if drive.arm in alike]
        refuse_other_revision(f"--baselines {baselines}", revisions, present["route"])
        return run, alike

    def _adopt(self, run: Run, alike: list[str]) -> None:
        """Copy the missing drives of some arms from an earlier run."""
        done, archive = self.done(), Archive(run.directory / TRACES)
        try:
            for (index, arm), result in run.drives.items():
                if arm in alike and self._wanted(result) and (index, arm) not in done:
                    self.add(_drive_in(archive, result))
        except RunError as error:
            raise UsageError(f"--baselines: {error}") from None

    def _pack_traces(self, loose: list[Path]) -> None:
        """Add the arrays of drives in files of their own to the packed traces."""
        target = self.folder / TRACES
        with replacing(target) as temporary:
            if target.exists():
                # Copied as a file, since compressing the arrays again would take hours.
                shutil.copyfile(target, temporary)
            with zipfile.ZipFile(temporary, "a", zipfile.ZIP_DEFLATED, compresslevel=4) as packed:
                names = {"facts.npy", *packed.namelist()}
                for path in loose:
                    with zipfile.ZipFile(path) as part:
                        for name in part.namelist():
                            if name not in names:
                                names.add(name)
                                packed.writestr(name, part.read(name))

    def _packed(self) -> tuple[list[DriveResult], list[DriveResult]]:
        """Return the drives in results.json, and those that are whole in traces.npz.

        Damaged files are set aside. What is whole in a damaged traces.npz becomes loose drives.
        """
        path, traces = self.folder / RESULTS, self.folder / TRACES
        if not path.exists() and not traces.exists():
            return [], []
        try:
            run = Run.read(self.folder)
        except RunError as error:
            # Without results, the traces cannot be assigned to drives.
            for damaged in (path, traces):
                if damaged.exists():
                    self.set_aside(damaged, str(error))
            return [], []
        self.skipped = run.skipped
        drives, archive = [*run.episodes, *run.unused], Archive(traces)
        if not traces.exists():
            return drives, []
        try:
            there = [drive for drive in drives if _archive_groups(drive)[0] in archive.groups]
        except RunError as error:
            self.set_aside(traces, str(error))
            return drives, []
        whole, faults = list[DriveResult](), dict[str, str]()
        for drive in there:
            names = [
                name for group in _archive_groups(drive) for name in archive.groups.get(group, ())
            ]
            try:
                Trace(traces, drive.index, drive.arm, archive).check(names)
                whole.append(drive)
            except RunError as error:
                faults[_archive_groups(drive)[0]] = str(error)
        if not faults:
            return drives, whole
        for drive in whole:
            self._save(_drive_in(archive, drive))
        why = next(iter(faults.values()))
        self.set_aside(traces, shown(f"arrays of {', '.join(faults)} do not read: {why}"))
        return drives, []

    def _loose(self, packed: set[tuple[int, str]]) -> list[DriveResult]:
        """Return the drives in files of their own that are not packed."""
        loose = []
        for path in self._parts():
            part = self.read(f"{PARTS}/{path.name}")
            if part is None:
                continue
            try:
                drive = DriveResult.from_json(part[0])
                if path != self.folder / _part(drive):
                    raise ValueError(f"it holds episode {drive.index} of {drive.arm}")
                Trace(path, drive.index, drive.arm, part[1]).check(part[1])
                loose.append(drive)
            except ValueError as error:
                self.set_aside(path, one_line(error))
        return [drive for drive in loose if (drive.index, drive.arm) not in packed]

    def _parts(self) -> list[Path]:
        return sorted((self.folder / PARTS).glob("*.npz"))


def _archive_groups(drive: DriveResult) -> tuple[str, str]:
    """Return the groups of a drive's own arrays and of its building's, see `Archive.groups`."""
    return f"e{drive.index}/{drive.arm}", f"w{drive.index}"


def _drive_in(archive: Archive, result: DriveResult) -> Drive:
    """Return a drive whose arrays are read from an archive."""
    names = (name for group in _archive_groups(result) for name in archive.groups.get(group, ()))
    arrays = {name: archive[name] for name in names}
    return Drive(result, Trace(archive.path, result.index, result.arm, arrays))


def _part(result: DriveResult) -> str:
    return f"{PARTS}/{result.index}-{result.arm}.npz"
