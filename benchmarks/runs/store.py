"""A run on disk: finished drives are kept one by one, then packed."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import zipfile
import zlib
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

from numpy.typing import NDArray

from benchmarks.runs.arms import ARMS
from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.optima import Key, task_key
from benchmarks.runs.saved_run import RESULTS, TRACES, UNNAMED, Run
from benchmarks.runs.settings import Settings
from benchmarks.runs.summary import gap, summarise
from benchmarks.runs.trace import RunError
from predictor.infra.command_line import UsageError
from predictor.infra.environment import commit, machine
from predictor.infra.errors import one_line
from predictor.infra.plain_json import loads
from predictor.infra.results_file import write_results
from predictor.infra.resumable import SETTINGS, ResumableFolder
from predictor.mapping.conventions import TICK

PARTS = "parts"
"""Folder of the drives that are not packed yet."""
GROWS = ("episodes", "arms")
"""Settings that a run may be continued with more of."""


class Store:
    """The folder of a run, which lets no other run in until the block ends or the process dies.

    Args:
        out: the folder; made if need be.
        settings: of the run.
        weights: fingerprint of the predictor's weights, if it has any.
        baselines: folder of an earlier run, whose drives of arms that ask no predictor, or the
            oracle, are taken over where these settings would give the same.

    Raises:
        UsageError: if the folder holds a run with other settings or weights, cannot be written, or
            another run is at work there; if that of the baselines holds no run, or none with a
            drive that would be the same.
    """

    def __init__(
        self, out: Path, settings: Settings, weights: str | None, baselines: Path | None = None
    ) -> None:
        self.out, self.settings = out, settings
        self.skipped: dict[int, str] = {}
        self.lost: list[tuple[int, str]] = []
        self._marked = _plain(settings) | {"weights": weights}
        adopted = None if baselines is None else self._checked(baselines)
        if not (out / SETTINGS).exists() and (out / RESULTS).exists():
            # Without settings, results that cannot be read may be anybody's.
            _results(out / RESULTS)
        # Some older runs name the control period too, which is no setting.
        self._folder = ResumableFolder(
            out, self._marked, grows=(*GROWS, "dt"), absent=UNNAMED, exclusive=True
        )
        self.notes = self._folder.notes
        self.commit = commit()
        packed = self._packed()
        self.episodes = packed + self._loose({(e.index, e.arm) for e in packed})
        if adopted is not None:
            self._adopt(adopted)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._folder.__exit__(*error)

    def done(self) -> set[tuple[int, str]]:
        """Episodes and arms that need not be driven again."""
        return {(e.index, e.arm) for e in self.episodes}

    def add(self, result: DriveResult, arrays: dict[str, NDArray[Any]]) -> None:
        """Keep a finished drive; after this a kill cannot lose it."""
        self._folder.write(_part(result), dataclasses.asdict(result), arrays)
        self.episodes.append(result)

    def pack(self, optima: Mapping[Key, float | None] | None = None) -> dict[str, Any]:
        """Write results.json and traces.npz from all that is finished, and return the results.

        Args:
            optima: T_opt of tasks [s]; by default episodes keep the one that they have.
        """
        arms = self.settings.arms
        chosen = [e for e in self.episodes if self._wanted(e)]
        if optima is not None:
            keys = [task_key(e.world, e.seed, e.start, e.goal) for e in chosen]
            chosen = [
                dataclasses.replace(e, t_opt=optima.get(key))
                for e, key in zip(chosen, keys, strict=True)
            ]
        chosen.sort(key=lambda e: (e.index, arms.index(e.arm)))
        # An interrupt may have left a drive on disk alone, for the next time.
        known = {self.out / _part(e) for e in self.episodes}
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
        write_results(self.out / RESULTS, "comparison", results)
        for path in loose:
            path.unlink()
        return results

    def _wanted(self, episode: DriveResult) -> bool:
        return episode.index < self.settings.episodes and episode.arm in self.settings.arms

    def _checked(self, baselines: Path) -> Run:
        try:
            run = Run.load(baselines)
        except RunError as error:
            raise UsageError(f"--baselines: {error}") from None
        other = self._other(run)
        arms = [arm for arm in self.settings.arms if ARMS[arm].predictor != "chosen"]
        if not arms:
            raise UsageError(
                "--baselines: all arms ask the chosen predictor, whose drives are never taken over"
            )
        if not any(ARMS[arm].drives_alike(other) for arm in arms):
            what = ", ".join(f"{k} {run.settings.get(k)}" for k in self._marked if k in other)
            raise UsageError(f"--baselines {baselines} holds a run with {what}")
        return run

    def _other(self, run: Run) -> set[str]:
        """Settings in which a run differs, but for those that may grow."""
        theirs = run.settings
        return {k for k, v in self._marked.items() if k not in GROWS and v != theirs.get(k)}

    def _adopt(self, run: Run) -> None:
        done, other = self.done(), self._other(run)
        try:
            arrays: dict[str, list[str]] = {}
            for name in run.archive.names:
                arrays.setdefault(name.rpartition("/")[0], []).append(name)
            for episode in run.episodes:
                index, arm = episode.index, episode.arm
                if (
                    self._wanted(episode)
                    and (index, arm) not in done
                    and ARMS[arm].drives_alike(other)
                ):
                    names = arrays.get(f"e{index}/{arm}", []) + arrays.get(f"w{index}", [])
                    self.add(episode, {name: run.archive.array(name) for name in names})
        except RunError as error:
            raise UsageError(f"--baselines: {error}") from None

    def _pack_traces(self, loose: list[Path]) -> None:
        target = self.out / TRACES
        temporary = target.with_suffix(".tmp")
        try:
            temporary.unlink(missing_ok=True)
            if target.exists():
                shutil.copyfile(target, temporary)
            self._append(temporary, loose)
        except BaseException:
            # On a full disk the half of it would be in the way.
            temporary.unlink(missing_ok=True)
            raise
        os.replace(temporary, target)

    @staticmethod
    def _append(temporary: Path, loose: list[Path]) -> None:
        """Add the arrays of loose drives to an archive that has not got them."""
        # What was packed before is copied as it is: to deflate it anew would take hours.
        with zipfile.ZipFile(temporary, "a", zipfile.ZIP_DEFLATED, compresslevel=4) as packed:
            names = set(packed.namelist())
            for path in loose:
                with zipfile.ZipFile(path) as part:
                    for name in part.namelist():
                        if name not in names and name != "facts.npy":
                            names.add(name)
                            packed.writestr(name, part.read(name))

    def _packed(self) -> list[DriveResult]:
        """Return the packed drives with results and traces; damaged files are set aside."""
        path, traces = self.out / RESULTS, self.out / TRACES
        if not path.exists() and not traces.exists():
            return []
        try:
            drives, self.skipped = _results(path)
        except UsageError as error:
            # Nobody can tell of what drives the traces are.
            for damaged in (path, traces):
                if damaged.exists():
                    self._folder.set_aside(damaged, str(error))
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
        """Return the names of the packed arrays whose drive and building are whole.

        A file with damaged ones is set aside, and one with what is good takes its place.
        """
        traces = self.out / TRACES
        if not traces.exists():
            return set()
        try:
            with zipfile.ZipFile(traces) as packed:
                names = {name.removesuffix(".npy"): name for name in packed.namelist()}
                bad = {
                    name.rpartition("/")[0]
                    for name, stored in names.items()
                    if not _reads(packed, stored)
                }
                if not bad:
                    return set(names)
                worlds = {group.removeprefix("w") for group in bad if group.startswith("w")}
                good = {
                    name: packed.read(stored)
                    for name, stored in names.items()
                    if name.rpartition("/")[0] not in bad
                    and name[1:].partition("/")[0] not in worlds
                }
        except (OSError, zipfile.BadZipFile) as error:
            self._folder.set_aside(traces, one_line(error))
            return set()
        self._folder.set_aside(
            traces, f"{len(names) - len(good)} of its {len(names)} arrays do not read"
        )
        temporary = traces.with_suffix(".tmp")
        with zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED, compresslevel=4) as anew:
            for name, data in good.items():
                anew.writestr(names[name], data)
        os.replace(temporary, traces)
        return set(good)

    def _loose(self, packed: set[tuple[int, str]]) -> list[DriveResult]:
        """Return the drives in files of their own that are not packed."""
        found = []
        for path in self._parts():
            part = self._folder.read(f"{PARTS}/{path.name}")
            try:
                result = None if part is None else DriveResult.from_json(part[0])
            except ValueError as error:
                self._folder.set_aside(path, str(error))
                continue
            if result is not None and (result.index, result.arm) not in packed:
                found.append(result)
        return found

    def _parts(self) -> list[Path]:
        return sorted((self.out / PARTS).glob("*.npz"))


def _results(path: Path) -> tuple[list[DriveResult], dict[int, str]]:
    """Return the drives of a results.json and why episodes are left out.

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
    """Return whether an entry can be read and is what was written."""
    try:
        packed.read(name)
    except (OSError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error):
        return False
    return True


def _part(result: DriveResult) -> str:
    return f"{PARTS}/{result.index}-{result.arm}.npz"


def _plain(settings: Settings) -> dict[str, Any]:
    plain: dict[str, Any] = json.loads(json.dumps(dataclasses.asdict(settings)))
    return plain
