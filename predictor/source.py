"""The source of a plug-in: the files of its author's own code, and a hash of them."""

from __future__ import annotations

import ast
import hashlib
import importlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from foresee.infra.plug_in import PlugInError
from foresee.mapping.kernels import PACKAGES

INSTALLED = ("site-packages", "dist-packages")
"""Names of folders of installed packages."""


@dataclass(frozen=True)
class Source:
    """The files of a plug-in, and a hash of them.

    These are the file of the module that the command line names, and all files of the same folder
    and below that it imports, directly or not. They are found by reading `import` statements, also
    those inside of functions. Installed packages do not count, nor do the packages of this project.

    Attributes:
        files: paths relative to the folder of the outermost package; the named module is the first.
        digest: SHA-256 of the file, in hexadecimal; if there are several, of their names and
            hashes.
    """

    files: tuple[str, ...]
    digest: str

    @classmethod
    def of(cls, spec: str) -> Self:
        """Return the source of `package.module:Class`, which must be importable.

        Raises:
            PlugInError: if the module, or one that it imports, has no readable file of Python code.
        """
        name = spec.partition(":")[0]
        module = importlib.import_module(name)
        if module.__file__ is None or not module.__file__.endswith(".py"):
            raise PlugInError(f"{spec!r}: module {name} is no file of Python code")
        file = Path(module.__file__)
        root = file.parents[name.count(".") + hasattr(module, "__path__")]
        top = name.partition(".")[0]
        hashes = dict[Path, str]()
        waiting = [file]
        while waiting:
            path = waiting.pop()
            if path in hashes:
                continue
            try:
                code = path.read_bytes()
                names = list(_imported(ast.parse(code), path.relative_to(root)))
            except (OSError, SyntaxError, ValueError) as error:
                raise PlugInError(f"{spec!r}: {path} cannot be read: {error}") from error
            hashes[path] = hashlib.sha256(code).hexdigest()
            for imported in names:
                first = imported.partition(".")[0]
                foreign = first in PACKAGES or root.name in INSTALLED
                if first == top or not foreign:
                    waiting += _files(root, imported)
        first_file, *others = ((path.relative_to(root).as_posix(), h) for path, h in hashes.items())
        pairs = [first_file, *sorted(others)]
        lines = "".join(f"{digest} {path}\n" for path, digest in pairs)
        whole = hashlib.sha256(lines.encode()).hexdigest()
        return cls(tuple(path for path, _ in pairs), whole if others else first_file[1])


def _imported(code: ast.Module, file: Path) -> Iterator[str]:
    """Yield the full names of what a module imports, which may be names inside of modules.

    Args:
        code: the module.
        file: its path, relative to the folder of the outermost package.
    """
    for node in ast.walk(code):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            # One dot is the package of the module, and each further dot the package above.
            package = file.parts[: len(file.parts) - node.level] if node.level else ()
            base = [*package, *filter(None, [node.module])]
            yield from (".".join([*base, alias.name]) for alias in node.names)


def _files(root: Path, name: str) -> Iterator[Path]:
    """Yield the files below a folder that are loaded when a name is imported, packages first."""
    parts = name.split(".")
    for length in range(1, len(parts) + 1):
        path = root.joinpath(*parts[:length])
        for file in (path.with_suffix(".py"), path / "__init__.py"):
            if file.is_file():
                yield file
