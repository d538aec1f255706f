"""A JSON file of drives that grows, drive by drive, so that an interrupted command can go on."""

from __future__ import annotations

import json
from collections.abc import Callable, Hashable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from tqdm import tqdm

from predictor.infra.atomic_file import write_whole
from predictor.infra.command_line import UsageError
from predictor.infra.results_file import COMMANDS, read_results
from predictor.infra.resumable import refuse_other_settings
from predictor.infra.workers import LostError, finished

Item = TypeVar("Item", bound=Hashable)


def read_drives(path: Path, kind: str) -> dict[str, Any]:
    """Read a file of drives: `kind`, `settings` and `drives`.

    Raises:
        UsageError: if it cannot be read, or is of another kind.
    """
    found = read_results(path)
    try:
        if found["kind"] == kind:
            # A drive without a number, or settings that are none, are somebody else's.
            [int(drive["index"]) for drive in found["drives"]]
            found["settings"].keys()
            return found
    except (ValueError, KeyError, TypeError, AttributeError):
        pass
    raise UsageError(f"{path} is no file of {COMMANDS[kind]}")


class DriveFile:
    """A file of drives; it is always whole.

    Args:
        path: of the file; made if need be.
        kind: of the results.
        settings: of the run, plain values.
        grows: the setting that may differ in a file that is continued: the number of drives.

    Raises:
        UsageError: if the file is of other settings or cannot be written.
    """

    def __init__(self, path: Path, kind: str, settings: dict[str, Any], grows: str) -> None:
        self.path = path
        self.drives: dict[int, dict[str, Any]] = {}
        self._head = {"kind": kind, "settings": settings}
        if path.exists():
            found = read_drives(path, kind)
            theirs = found["settings"]
            refuse_other_settings(path, settings, theirs, (grows,))
            self.drives = {drive["index"]: drive for drive in found["drives"]}
            self._head["settings"] = settings | {grows: max(settings[grows], theirs[grows])}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UsageError(f"--out: {path.parent} cannot be made: {error.strerror}") from None
        # Now, not after the first drive.
        self._write()

    def add(self, drive: dict[str, Any]) -> None:
        """Keep a drive, and write the file anew.

        Raises:
            UsageError: if it cannot be written.
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
    ) -> dict[Item, str]:
        """Do the drives that the file lacks, with a progress bar.

        Args:
            work: does a drive, or says in a line why there is none; see `finished`.
            items: one for each drive, in the order of their numbers.
            jobs: worker processes.
            about: tells of a drive beside the bar.
            enough: whether the drives that there are will do; asked after each.

        Returns:
            The items without a drive, and why.

        Raises:
            UsageError: if drives are lost because processes died, or the file cannot be written.
        """
        todo = [item for index, item in enumerate(items) if index not in self.drives]
        skipped = dict[Item, str]()
        if enough():
            return skipped
        with tqdm(total=len(items), initial=len(items) - len(todo), unit="drive") as bar:
            try:
                for item, found in finished(work, todo, jobs):
                    if isinstance(found, str):
                        skipped[item] = found
                    else:
                        self.add(found)
                        bar.set_postfix_str(about(found))
                    bar.update()
                    if enough():
                        break
            except LostError as error:
                raise UsageError(f"{error}; the same command tries again") from None
        return skipped

    def first(self, count: int) -> list[dict[str, Any]]:
        """Return those of the first drives that are there."""
        return [self.drives[index] for index in range(count) if index in self.drives]

    def _write(self) -> None:
        # A line a drive, so that a change of one is a change of a line.
        lines = [_json(self.drives[index]) for index in sorted(self.drives)]
        text = f'{_json(self._head)[:-1]},"drives":[\n' + ",\n".join(lines) + "\n]}\n"
        try:
            write_whole(self.path, text.encode())
        except OSError as error:
            raise UsageError(f"--out: {self.path} cannot be written: {error.strerror}") from None


def _json(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False)
