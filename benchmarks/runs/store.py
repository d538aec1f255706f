"""The folder of a running comparison: drives are saved one by one, and packed at the end."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.optima import Key, task_key
from benchmarks.runs.saved_run import RESULTS, TRACES, Run, RunError
from benchmarks.runs.settings import ARMS, OLDER, Settings
from benchmarks.runs.summary import gap, summarise
from foresee.infra.command_line import UsageError
from foresee.infra.environment import commit, machine
from foresee.infra.errors import one_line
from foresee.infra.plain_json import loads
from foresee.infra.results_file import write_results
from foresee.infra.resumable import SETTINGS, UNREADABLE, ResumableFolder
from foresee.mapping.conventions import TICK

PARTS = "parts"
"""Folder of the drives that are not packed yet."""
GROWS = ("episodes", "arms")
"""Settings that may differ when a run is continued."""


class Store(ResumableFolder):
    """The folder of a run, locked against other runs until it is closed or the process ends.

    Args:
        out: folder of the run; made if it is missing.
        settings: settings of the run.
        weights: fingerprint of the predictor's weights; None: it has none.
        baselines: folder of an earlier run. Its drives of arms that do not use the chosen predictor
            are copied, if they would be the same with these settings.

    Attributes:
        episodes: results of the finished drives.
        skipped: number of an episode → reason why it has no task.
        lost: episodes and arms whose worker processes died.

    Raises:
        UsageError: if the folder holds a run with other settings or weights, cannot be written, or
            is in use by another run; if the folder of the baselines holds no run, or no drive that
            would be the same.
    """

    def __init__(
        self, out: Path, settings: Settings, weights: str | None, baselines: Path | None = None
    ) -> None:
        self.settings = settings
        self.skipped: dict[int, str] = {}
        self.lost: list[tuple[int, str]] = []
        # Converted to JSON and back, to be compared with the settings in files.
        self._marked = json.loads(json.dumps(dataclasses.asdict(settings) | {"weights": weights}))
        adopted = None if baselines is None else self._checked(baselines)
        if not (out / SETTINGS).exists() and (out / RESULTS).exists():
            # A folder without settings must at least hold readable results; this raises if not.
            _results(out / RESULTS)
        # Some older runs also name the control period, which is not a setting.
        grows = (*GROWS, "dt")
        super().__init__(out, self._marked, grows=grows, absent=OLDER, exclusive=True)
        self.commit = commit()
        packed = self._packed()
        self.episodes = packed + self._loose({(e.index, e.arm) for e in packed})
        if adopted is not None:
            self._adopt(*adopted)

    def done(self) -> set[tuple[int, str]]:
        """Return the episodes and arms that have been driven."""
        return {(e.index, e.arm) for e in self.episodes}

    def add(self, result: DriveResult, arrays: dict[str, NDArray[Any]]) -> None:
        """Save a finished drive; afterwards it survives a kill of the process."""
        self.write(_part(result), dataclasses.asdict(result), arrays)
        self.episodes.append(result)

    def pack(self, optima: Mapping[Key, float | None] | None = None) -> dict[str, Any]:
        """Write results.json and traces.npz of all finished drives, and return the results.

        Args:
            optima: task → least time T_opt [s]; None: the results keep their own.
        """
        arms = self.settings.arms
        chosen = [e for e in self.episodes if self._wanted(e)]
        if optima is not None:
            chosen = [
                dataclasses.replace(e, t_opt=optima.get(task_key(e.world, e.seed, e.start, e.goal)))
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
            "version": version("foresee"),
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
        mine, theirs = self._marked, run.settings
        other = {k for k, v in mine.items() if k not in GROWS and v != theirs.get(k)}
        arms = [arm for arm in self.settings.arms if not ARMS[arm].has_predictor]
        if not arms:
            raise UsageError(
                "--baselines: only drives without the chosen predictor and predicted frontiers are "
                "copied, and no arm makes such drives"
            )
        alike = [arm for arm in arms if ARMS[arm].drives_alike(other)]
        if not alike:
            what = ", ".join(f"{k} {theirs.get(k)}" for k in mine if k in other)
            raise UsageError(f"--baselines {baselines} holds a run with {what}")
        return run, alike

    def _adopt(self, run: Run, alike: list[str]) -> None:
        """Copy the missing drives of some arms from an earlier run."""
        done = self.done()
        try:
            arrays: dict[str, list[str]] = {}
            for name in run.archive.names:
                arrays.setdefault(name.rpartition("/")[0], []).append(name)
            for (index, arm), drive in run.drives.items():
                if arm in alike and self._wanted(drive) and (index, arm) not in done:
                    names = arrays.get(f"e{index}/{arm}", []) + arrays.get(f"w{index}", [])
                    self.add(drive, {name: run.archive.array(name) for name in names})
        except RunError as error:
            raise UsageError(f"--baselines: {error}") from None

    @contextmanager
    def _traces(self) -> Iterator[zipfile.ZipFile]:
        """Open a copy of the packed traces for adding; at the end it replaces the original."""
        target = self.folder / TRACES
        temporary = target.with_suffix(".tmp")
        try:
            temporary.unlink(missing_ok=True)
            if target.exists():
                # Copied as a file, since compressing the arrays again would take hours.
                shutil.copyfile(target, temporary)
            with zipfile.ZipFile(temporary, "a", zipfile.ZIP_DEFLATED, compresslevel=4) as packed:
                yield packed
            os.replace(temporary, target)
        except BaseException:
            # The incomplete file is removed, since the disk may be full.
            temporary.unlink(missing_ok=True)
            raise

    def _pack_traces(self, loose: list[Path]) -> None:
        with self._traces() as packed:
            names = {"facts.npy", *packed.namelist()}
            for path in loose:
                with zipfile.ZipFile(path) as part:
                    for name in part.namelist():
                        if name not in names:
                            names.add(name)
                            packed.writestr(name, part.read(name))

    def _packed(self) -> list[DriveResult]:
        """Return the packed drives that have results and traces; damaged files are set aside."""
        path, traces = self.folder / RESULTS, self.folder / TRACES
        if not path.exists() and not traces.exists():
            return []
        try:
            drives, self.skipped = _results(path)
        except UsageError as error:
            # Without results, the traces cannot be assigned to drives.
            for damaged in (path, traces):
                if damaged.exists():
                    self.set_aside(damaged, str(error))
            return []
        good = self._good_traces()
        kept = [drive for drive in drives if f"e{drive.index}/{drive.arm}/states" in good]
        if len(kept) < len(drives):
            self.notes.append(
                f"{len(drives) - len(kept)} of {len(drives)} drives have lost their "
                "traces and are driven again"
            )
        return kept

    def _good_traces(self) -> set[str]:
        """Return the names of the packed arrays of drives whose arrays and building are undamaged.

        If there are damaged arrays, the file is set aside, and the undamaged ones are written anew.
        """
        traces = self.folder / TRACES
        if not traces.exists():
            return set()
        try:
            with zipfile.ZipFile(traces) as packed:
                names = [name.removesuffix(".npy") for name in packed.namelist()]
                bad = {name.rpartition("/")[0] for name in names if not _reads(packed, name)}
                # A drive cannot be used without the map of its building.
                worlds = {group[1:] for group in bad if group.startswith("w")}
                good = {
                    name: packed.read(f"{name}.npy")
                    for name in (names if bad else [])
                    if name.rpartition("/")[0] not in bad
                    and name[1:].partition("/")[0] not in worlds
                }
        except (OSError, zipfile.BadZipFile) as error:
            self.set_aside(traces, one_line(error))
            return set()
        if not bad:
            return set(names)
        lost = len(names) - len(good)
        self.set_aside(traces, f"{lost} of its {len(names)} arrays do not read")
        with self._traces() as anew:
            for name, data in good.items():
                anew.writestr(f"{name}.npy", data)
        return set(good)

    def _loose(self, packed: set[tuple[int, str]]) -> list[DriveResult]:
        """Return the drives in files of their own that are not packed."""
        found = []
        for path in self._parts():
            try:
                if part := self.read(f"{PARTS}/{path.name}"):
                    found.append(DriveResult.from_json(part[0]))
            except ValueError as error:
                self.set_aside(path, str(error))
        return [drive for drive in found if (drive.index, drive.arm) not in packed]

    def _parts(self) -> list[Path]:
        return sorted((self.folder / PARTS).glob("*.npz"))


def _results(path: Path) -> tuple[list[DriveResult], dict[int, str]]:
    """Read the drives of a results.json, and the reasons why episodes are left out.

    Raises:
        UsageError: if it is damaged or of another version.
    """
    try:
        results = loads(path.read_text())
        skipped = {int(k): str(v) for k, v in results["skipped"].items()}
        drives = [*map(DriveResult.from_json, [*results["episodes"], *results["unused"]])]
    except (ValueError, KeyError, TypeError, AttributeError, OSError) as error:
        raise UsageError(f"{path} cannot be read: {one_line(error)}") from None
    return drives, skipped


def _reads(packed: zipfile.ZipFile, name: str) -> bool:
    """Return whether an array of an archive can be read, with the right checksum."""
    try:
        packed.read(f"{name}.npy")
    except (*UNREADABLE, RuntimeError):
        return False
    return True


def _part(result: DriveResult) -> str:
    return f"{PARTS}/{result.index}-{result.arm}.npz"
