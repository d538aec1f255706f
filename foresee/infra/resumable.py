"""Folders of results that a command continues after an interruption, when it is given again."""

from __future__ import annotations

import fcntl
import itertools
import json
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, BinaryIO, Self

from numpy.typing import NDArray

from foresee.infra.atomic_file import clear, write_whole
from foresee.infra.command_line import UsageError
from foresee.infra.errors import one_line
from foresee.infra.input_file import check_input
from foresee.infra.part_file import Part, read_part, write_part
from foresee.infra.plain_json import read_json, read_object

SETTINGS = "settings.json"
"""Name of the file with the settings that the results of a folder were made with."""


class ResumableFolder:
    """A folder in which each finished part of a long computation is a file.

    Parts are written atomically, so that a killed process loses only unfinished parts. A damaged
    part is renamed to end with `.damaged`, reported in `notes`, and counts as missing.

    Args:
        folder: folder of the results; made if it is missing.
        settings: all settings that decide the results, plain data for JSON; None: the settings are
            not checked, since each part contains its own.
        marker: name of the file in which the settings are kept.
        grows: names of settings that may differ from those of an earlier run, such as the number of
            drives.
        absent: values of settings that older folders do not name.
        unchecked: names of settings that are not compared with a folder that does not name them; a
            line in `notes` says so.
        exclusive: whether to refuse other processes until this one closes the folder or ends.

    Attributes:
        notes: one line for each damaged file, and for each setting that was not compared.

    Raises:
        UsageError: if the folder holds results with other settings, cannot be written, or is in
            use by another process.
    """

    def __init__(
        self,
        folder: Path,
        settings: Mapping[str, Any] | None = None,
        *,
        marker: str = SETTINGS,
        grows: Iterable[str] = (),
        absent: Mapping[str, Any] | None = None,
        unchecked: Iterable[str] = (),
        exclusive: bool = False,
    ) -> None:
        self.folder, self.notes = folder, list[str]()
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._lock = lock(folder / ".lock", folder) if exclusive else None
        except UsageError:
            raise
        except (OSError, ValueError) as error:
            raise UsageError(f"{folder} cannot be used: {one_line(error)}") from None
        clear(folder)
        path = folder / marker
        if settings is None:
            return
        if path.exists():
            try:
                earlier = dict(absent or {}) | read_object(path)
            except (OSError, ValueError) as error:
                raise UsageError(f"{path} cannot be read: {one_line(error)}") from None
            older = [name for name in unchecked if name in settings and name not in earlier]
            self.notes += [f"{folder} does not name its {name}: not compared" for name in older]
            refuse_other_settings(folder, settings, earlier, (*grows, *older))
        write_whole(path, json.dumps(settings, indent=1).encode())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._lock is not None:
            self._lock.close()

    def write(self, name: str, facts: dict[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
        """Write a part; afterwards it survives a kill of the process.

        Args:
            name: path of its file inside the folder, such as "parts/1.npz".
            facts: facts of the part, plain data for JSON.
            arrays: arrays of the part by name.
        """
        path = self.folder / name
        path.parent.mkdir(exist_ok=True)
        write_part(path, facts, arrays)

    def read(self, name: str) -> Part | None:
        """Read a part; None if it is missing or damaged. A damaged file is set aside."""
        path = self.folder / name
        try:
            return read_part(path)
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            self.set_aside(path, one_line(error))
            return None

    def once(self, name: str, measure: Callable[[], Any]) -> Any:
        """Return a stored measurement, or measure and store it.

        Args:
            name: path of its JSON file inside the folder.
            measure: function that returns plain data for JSON.
        """
        path = self.folder / name
        try:
            return read_json(path)
        except FileNotFoundError:
            pass
        except (OSError, ValueError) as error:
            self.set_aside(path, one_line(error))
        measured = measure()
        write_whole(path, json.dumps(measured).encode())
        return measured

    def set_aside(self, path: Path, why: str) -> None:
        """Rename a damaged file so that it ends with `.damaged`, and add a line to `notes`."""
        names = (path.with_name(f"{path.name}.damaged{n or ''}") for n in itertools.count())
        target = next(name for name in names if not name.exists())
        path.rename(target)
        self.notes.append(f"{path} is damaged ({why}); it is kept as {target.name}")


def lock(path: Path, what: Path) -> BinaryIO:
    """Open and lock a file, by which a process excludes others until it closes it or ends.

    Args:
        path: path of the lock.
        what: folder or file from which others are excluded.

    Raises:
        UsageError: if another process holds the lock.
        OSError: if it cannot be opened.
        ValueError: if it is no plain, empty file.
    """
    while True:
        if path.exists():
            check_input(path, 0)
        file = path.open("ab")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.close()
            raise UsageError(f"{what} is in use: another run is at work there") from None
        # Who held it may have removed it since it was opened.
        if path.exists() and os.path.samestat(os.fstat(file.fileno()), path.stat()):
            return file
        file.close()


def unlock(path: Path, file: BinaryIO, process: int) -> None:
    """Remove and close a lock, in the process that holds it.

    Args:
        path: path of the lock.
        file: what `lock` returned.
        process: number of the process that called `lock`; others inherit the file if they fork.
    """
    if os.getpid() == process:
        path.unlink(missing_ok=True)
    file.close()


def refuse_other_settings(
    where: Path, present: Mapping[str, Any], earlier: Mapping[str, Any], grows: Iterable[str] = ()
) -> None:
    """Refuse earlier results that were made with other settings.

    Args:
        where: folder or file of the results.
        present: settings of this run.
        earlier: settings of the earlier results, as read from JSON.
        grows: names of settings that may differ.

    Raises:
        UsageError: if other settings differ; the message names them.
    """
    plain = json.loads(json.dumps(present))
    other = [k for k in plain | earlier if k not in grows and plain.get(k) != earlier.get(k)]
    if other:
        listed = ", ".join(difference(k, plain, earlier) for k in other)
        raise UsageError(f"{where} holds a run with {listed}; choose another place")


def difference(name: str, present: Mapping[str, Any], earlier: Mapping[str, Any]) -> str:
    """Return a setting of earlier results that differs, as text; of an object, what differs in it.

    Args:
        name: name of the setting.
        present: settings of this run, plain data.
        earlier: settings of the earlier results.
    """
    if name not in earlier:
        return f"no {name}"
    here, there = present.get(name), earlier[name]
    if not (isinstance(here, dict) and isinstance(there, dict)):
        return f"{name} {there}"
    return f"other {name}: " + ", ".join(
        str(key) for key in here | there if here.get(key) != there.get(key)
    )
