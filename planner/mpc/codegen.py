"""Compile casadi functions to machine code, once, and keep the libraries between runs."""

from __future__ import annotations

import hashlib
import os
import platform
import shlex
import shutil
import subprocess
import tempfile
import warnings
from pathlib import Path

import casadi as ca

from foresee.infra.cache_folder import cache_folder

FLAGS = ("-O2", "-ffp-contract=off", "-fPIC", "-shared")
"""Options of the compiler; without fused operations, results equal those of the interpreter."""


class InterpretedWarning(UserWarning):
    """A function could not be compiled, and runs in casadi's interpreter."""


def compiled(function: ca.Function) -> ca.Function:
    """Return the same function, compiled by the C compiler (`$CC`, or else `cc`).

    The library is kept in the user's cache, under a hash of its source and of the compiler. It is
    moved there when it is complete, so that several processes may compile it at the same time.

    Args:
        function: casadi function without external dependencies.

    Returns:
        The compiled function; with an `InterpretedWarning` the function itself, if there is no
        compiler, the compiler fails, or no cache folder can be written.
    """
    generator = ca.CodeGenerator(function.name(), {"casadi_int": "long long int"})
    generator.add(function)
    source = generator.dump()
    # $CC may have options, or a launcher before the compiler.
    program, *options = shlex.split(os.environ.get("CC", "")) or ["cc"]
    executable = shutil.which(program)
    if executable is None:
        return _interpreted(function, "no C compiler was found (cc, or what $CC names)")
    compiler = [executable, *options]
    # Machines of different kinds may share a home folder, and with it the cache.
    made_of = (source, *compiler, platform.machine(), *FLAGS)
    key = hashlib.sha256("\0".join(made_of).encode()).hexdigest()[:32]
    folder = cache_folder()
    if folder is None:
        return _interpreted(function, "no cache folder can be written")
    try:
        library = folder / f"{function.name()}-{key}.so"
        if not library.exists():
            _build(compiler, source, library)
        try:
            return ca.external(function.name(), str(library))
        except RuntimeError:
            # The library is damaged.
            _build(compiler, source, library)
            return ca.external(function.name(), str(library))
    except subprocess.CalledProcessError as error:
        command = shlex.join(compiler)
        said = error.stderr.decode(errors="replace").strip()
        return _interpreted(function, f"{command} failed: {said[-200:]}")
    except (OSError, RuntimeError) as error:
        return _interpreted(function, " ".join(str(error).split())[:200])


def _build(compiler: list[str], source: str, library: Path) -> None:
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        code, made = Path(folder) / "function.c", Path(folder) / "function.so"
        code.write_text(source, encoding="utf-8")
        command = [*compiler, *FLAGS, str(code), "-o", str(made), "-lm"]
        subprocess.run(command, check=True, capture_output=True)
        os.replace(made, library)


def _interpreted(function: ca.Function, why: str) -> ca.Function:
    warnings.warn(
        f"{why}: {function.name()} runs interpreted; the results are the same, but a solve of the "
        "MPC takes about 1.6 times as long",
        InterpretedWarning,
        stacklevel=3,
    )
    return function
