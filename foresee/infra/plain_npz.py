"""NumPy archives from untrusted files: sizes are checked before anything is read."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from foresee.infra.errors import LineError, one_line
from foresee.infra.input_file import check_input

MOST_BYTES = 2**29
"""Largest size of all arrays of an archive [bytes]; the parts of results have a few percent."""
LARGEST_FILE = 2**40
"""Largest archive that is opened [bytes]."""
ENDING = ".npy"
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Ways of compression that NumPy uses. The decoders of others unpack without a limit."""


class NpzError(LineError):
    """A NumPy archive is broken, too large, or holds something that is refused."""


class Head(NamedTuple):
    """Type and shape of an array, and the order of its values."""

    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    order: Literal["C", "F"]


class PlainNpz:
    """An open NumPy archive of plain arrays, which are read one by one.

    Args:
        path: path of the file.

    Attributes:
        names: names of the arrays.

    Raises:
        OSError: if the file cannot be read.
        NpzError: if it is no NumPy archive.
    """

    def __init__(self, path: Path) -> None:
        try:
            check_input(path, LARGEST_FILE)
            self._zip = zipfile.ZipFile(path)
        except OSError:
            raise
        except Exception as error:
            # On broken files zipfile and numpy raise exceptions of any kind, here and below.
            raise NpzError(f"it is no NumPy archive: {one_line(error)}") from error
        members = dict.fromkeys(self._zip.namelist())
        self.names = [name.removesuffix(ENDING) for name in members if name.endswith(ENDING)]
        if len(self.names) < len(members):
            self.close()
            raise NpzError("it holds something else than arrays")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._zip.close()

    def size(self, name: str) -> int:
        """Return the size of an array's member, unpacked [bytes], as the archive states it.

        Raises:
            NpzError: if there is no such array.
        """
        try:
            return self._zip.getinfo(name + ENDING).file_size
        except KeyError:
            raise NpzError(f"it holds no {name!r}") from None

    def head(self, name: str, most: int = MOST_BYTES) -> Head:
        """Return type and shape of an array, which is not read.

        Args:
            name: name of the array.
            most: largest size allowed [bytes].

        Raises:
            NpzError: if there is no such array, it is too large, holds Python objects, or its
                header contradicts its size.
        """
        with self._opened(name, most) as (_, head):
            return head

    def read(self, name: str, most: int = MOST_BYTES) -> NDArray[Any]:
        """Return an array.

        Args:
            name: name of the array.
            most: largest size allowed [bytes].

        Raises:
            NpzError: if `head` refuses the array, or its values are damaged.
        """
        with self._opened(name, most) as (file, head):
            data = bytearray(math.prod(head.shape) * head.dtype.itemsize)
            if file.readinto(data) != len(data):
                raise EOFError("it is cut off")
            return np.ndarray(head.shape, head.dtype, data, order=head.order)

    @contextmanager
    def _opened(self, name: str, most: int) -> Iterator[tuple[zipfile.ZipExtFile, Head]]:
        """Open an array after its header, which is checked; raise NpzError if it is broken."""
        size = self.size(name)
        if size > most:
            raise NpzError(f"{name!r} is larger than {most} bytes")
        try:
            info = self._zip.getinfo(name + ENDING)
            if info.compress_type not in METHODS:
                raise ValueError("it is compressed in a way that is not supported")
            with self._zip.open(info) as file:
                assert isinstance(file, zipfile.ZipExtFile)
                if np.lib.format.read_magic(file) != (1, 0):
                    raise ValueError("it is not of NumPy's format 1.0")
                shape, fortran, dtype = np.lib.format.read_array_header_1_0(file)
                if dtype.hasobject or not dtype.itemsize:
                    raise ValueError(f"its type {dtype} is not supported")
                left = size - file.tell()
                if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != left:
                    raise ValueError(f"it is not of shape {shape} and type {dtype}, as it says")
                yield file, Head(dtype, shape, "F" if fortran else "C")
        except Exception as error:
            raise NpzError(f"{name!r} is broken: {one_line(error)}") from error


def read_npz(
    path: Path, most: int = MOST_BYTES, names: Iterable[str] | None = None
) -> dict[str, NDArray[Any]]:
    """Read the arrays of an archive.

    Args:
        path: path of the file.
        most: largest size of all these arrays together [bytes].
        names: names of the arrays; None: all.

    Returns:
        The arrays by name.

    Raises:
        OSError: if the file cannot be read.
        NpzError: if it is broken, or the arrays are too large.
    """
    with PlainNpz(path) as archive:
        chosen = archive.names if names is None else list(names)
        if sum(map(archive.size, chosen)) > most:
            raise NpzError(f"its arrays have over {most} bytes")
        return {name: archive.read(name, most) for name in chosen}
