"""A JSON file of drives that grows, drive by drive, so that an interrupted command can go on."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from predictor.infra.atomic_file import write_whole
from predictor.infra.command_line import UsageError
from predictor.infra.plain_json import loads
from predictor.infra.resumable import refuse_other_settings


def read_drives(path: Path, command: str) -> dict[str, Any]:
    """Read a file of drives: `command`, `settings` and `drives`.

    Args:
        path: of the file.
        command: that must have written it.

    Raises:
        UsageError: if it cannot be read, or is something else.
    """
    try:
        found = loads(path.read_text())
        if found["command"] == command:
            # A drive without a number, or settings that are none, are somebody else's.
            [int(drive["index"]) for drive in found["drives"]]
            found["settings"].keys()
            return dict(found)
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        pass
    raise UsageError(f"{path} is no file of {command}")


class DriveFile:
    """A file of drives; it is always whole.

    Args:
        path: of the file; made if need be.
        command: that writes it.
        settings: of the run, plain values.
        grows: the setting that may differ in a file that is continued: the number of drives.

    Raises:
        UsageError: if the file is of other settings or cannot be written.
    """

    def __init__(self, path: Path, command: str, settings: dict[str, Any], grows: str) -> None:
        self.path = path
        self.drives: dict[int, dict[str, Any]] = {}
        self._head = {"command": command, "settings": settings}
        if path.exists():
            found = read_drives(path, command)
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
