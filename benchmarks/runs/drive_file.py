"""A JSON file of drives that grows, drive by drive, so that an interrupted command can go on."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from predictor.infra.atomic_file import write_whole
from predictor.infra.command_line import UsageError
from predictor.infra.results_file import COMMANDS, read_results
from predictor.infra.resumable import refuse_other_settings


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
