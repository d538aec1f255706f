"""A JSON file to which drives are added one by one, so that an interrupted command can continue."""

from __future__ import annotations

import json
import os
import weakref
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import MISSING
from itertools import takewhile
from pathlib import Path
from typing import Any, TypeVar

from foresee.infra.atomic_file import write_whole
from foresee.infra.command_line import UsageError
from foresee.infra.errors import one_line
from foresee.infra.markdown import records
from foresee.infra.plain_json import fits
from foresee.infra.progress import progress
from foresee.infra.results_file import COMMANDS, read_results
from foresee.infra.resumable import lock, refuse_other_settings, unlock
from foresee.infra.workers import finished
from planner.revision import revision_of

ENTRY = {"index": int}
"""Facts that each drive of any kind must have, and their types."""
NO_TASK = "no task"
"""Outcome in a building without a route that the car can drive."""
Item = TypeVar("Item", bound=Hashable)


def read_drives(path: Path, kind: str, entry: Mapping[str, Any] = ENTRY) -> dict[str, Any]:
    """Read a file of drives: `kind`, `settings` and `drives`.

    Args:
        path: path of the file.
        kind: kind of the results.
        entry: facts that each drive must have, and their types, see `plain_json.fits`.

    Raises:
        UsageError: if it cannot be read, is of another kind, or lacks facts of a drive.
    """
    content = read_results(path)
    drives = content.get("drives")
    if (
        content["kind"] != kind
        or not isinstance(content.get("settings"), dict)
        or not isinstance(drives, list)
    ):
        raise UsageError(f"{path} is no file of {COMMANDS[kind]}")
    for drive in drives:
        facts = drive if isinstance(drive, dict) else {}
        wrong = [name for name, hint in entry.items() if not fits(facts.get(name, MISSING), hint)]
        if wrong:
            raise UsageError(
                f"{path} is no file of {COMMANDS[kind]}: a drive lacks a proper {wrong[0]}"
            )
    return content


def refuse_other_revision(where: str, revisions: Iterable[int], route: str) -> None:
    """Refuse to use drives that another revision of the planner has made.

    Args:
        where: where the drives are, with the option that names it.
        revisions: revision that made each of the drives.
        route: kind of their routes, "free" or "fixed".

    Raises:
        UsageError: if one of them differs from the present revision.
    """
    present = revision_of(route)
    other = sorted({revision for revision in revisions if revision != present})
    if other:
        raise UsageError(
            f"{where} holds drives of revision {other[0]} of the planner, and this is revision "
            f"{present}; drives of both are not mixed: choose another place"
        )


class DriveFile:
    """A file of drives, which is written atomically after each drive, by one process at a time.

    Args:
        path: path of the file; it is made if it is missing.
        kind: kind of the results, a key of `foresee.infra.results_file.COMMANDS`.
        settings: settings of the run, plain data for JSON.
        grows: name of the setting that may differ in a file that is continued: the number of
            drives.
        absent: values of settings that older files do not contain.
        entry: facts that each drive must have, and their types.

    Raises:
        UsageError: if the file has other settings, or is in use by another process.
        OSError: if it cannot be written.
    """

    def __init__(
        self,
        path: Path,
        kind: str,
        settings: dict[str, Any],
        grows: str,
        absent: Mapping[str, Any] | None = None,
        entry: Mapping[str, Any] = ENTRY,
    ) -> None:
        self.path = path
        self.drives: dict[int, dict[str, Any]] = {}
        self._head = {"kind": kind, "settings": settings}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            held = path.with_name(f".{path.name}.lock")
            # Removed with this object, or at the end of the process.
            weakref.finalize(self, unlock, held, lock(held, path), os.getpid())
        except UsageError:
            raise
        except (OSError, ValueError) as error:
            raise UsageError(f"--out: {path} cannot be made: {one_line(error)}") from None
        if path.exists():
            content = read_drives(path, kind, entry)
            earlier = dict(absent or {}) | content["settings"]
            refuse_other_settings(path, settings, earlier, (grows,))
            self.drives = {drive["index"]: drive for drive in content["drives"]}
            if not fits(earlier.get(grows), int):
                raise UsageError(f"{path} is no file of {COMMANDS[kind]}: it has no {grows}")
            self._head["settings"] = settings | {grows: max(settings[grows], earlier[grows])}
        # Written at once, so that an error is not found only after the first drive.
        self._write()

    def add(self, drive: dict[str, Any]) -> None:
        """Add a drive, and write the file.

        Raises:
            OSError: if it cannot be written.
        """
        self.drives[drive["index"]] = drive
        self._write()

    def fill(
        self,
        work: Callable[[Item], dict[str, Any] | str],
        items: Sequence[Item],
        jobs: int,
        about: Callable[[dict[str, Any]], str],
        enough: Callable[[], bool] = lambda: False,
        unit: str = "drive",
    ) -> dict[Item, str]:
        """Make the drives that are missing in the file, with a progress bar.

        Args:
            work: function from an item to a drive, or to a line that says why there is none; see
                `foresee.infra.workers.finished`.
            items: item of each drive, in the order of the drives' numbers.
            jobs: number of worker processes.
            about: function from a drive to the text beside the progress bar.
            enough: function that is called after each drive; True: no more drives are needed.
            unit: what the progress bar counts.

        Returns:
            The items without a drive, each with the reason.

        Raises:
            LostError: if drives are lost because processes died; all others are made.
            OSError: if the file cannot be written.
        """
        todo = [item for index, item in enumerate(items) if index not in self.drives]
        skipped = dict[Item, str]()
        if enough():
            return skipped
        with progress(total=len(items), initial=len(items) - len(todo), unit=unit) as bar:
            for item, content in finished(work, todo, jobs):
                if isinstance(content, str):
                    skipped[item] = content
                else:
                    self.add(content)
                    bar.set_postfix_str(about(content), refresh=False)
                bar.update()
                if enough():
                    break
        return skipped

    def first(self, count: int) -> list[dict[str, Any]]:
        """Return the drives whose number is below `count`, as far as they have been made."""
        return [self.drives[index] for index in range(count) if index in self.drives]

    def unbroken(self, count: int) -> list[dict[str, Any]]:
        """Return the drives whose number is below `count`, up to the first missing one.

        Drives after it would be a biased sample: short drives end first, and collisions are short.
        """
        return [self.drives[i] for i in takewhile(lambda i: i in self.drives, range(count))]

    def _write(self) -> None:
        # One line for each drive, so that differences between files are easy to see.
        lines = [_json(self.drives[index]) for index in sorted(self.drives)]
        text = f'{_json(self._head)[:-1]},"drives":[\n' + ",\n".join(lines) + "\n]}\n"
        try:
            # Half a surrogate pair, which a file may hold, is written as JSON writes it: \ud800.
            write_whole(self.path, text.encode(errors="backslashreplace"))
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.path)) from None


def table_of_outcomes(content: Mapping[str, Any]) -> str:
    """Return the outcomes of the drives in a file as a Markdown table."""
    outcomes = Counter(drive["outcome"] for drive in content["drives"])
    return records([{"outcome": name, "drives": count} for name, count in sorted(outcomes.items())])


def _json(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False)
