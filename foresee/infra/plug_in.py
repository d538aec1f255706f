"""Plug-ins: classes and functions that a command line names as `package.module:Class`."""

from __future__ import annotations

import importlib
import os
import sys
from types import ModuleType
from typing import Any

from foresee.infra.errors import LineError, one_line


class PlugInError(LineError):
    """There is no such plug-in, or its module cannot be imported; the message is one line."""


def load_plug_in(spec: str, what: str) -> Any:
    """Return the class, or other object, that `package.module:Class` names.

    Args:
        spec: name of the module and, after a colon, of the object in it. The module is looked for
            where Python looks, and in the current working directory.
        what: what the object is, for error messages, such as "predictor".

    Raises:
        PlugInError: if there is no such module or object, or the module cannot be imported.
    """
    path, _, attribute = spec.partition(":")
    if not path or not attribute or path.startswith("."):
        raise PlugInError(f"{spec!r} is not of the form package.module:Class")
    found: Any = _module(path, f"{what} {spec!r}")
    for name in attribute.split("."):
        if not hasattr(found, name):
            raise PlugInError(f"{what} {spec!r}: module {path} has no {attribute}")
        found = getattr(found, name)
    return found


def _module(path: str, name: str) -> ModuleType:
    here = os.getcwd()
    if here not in sys.path and "" not in sys.path:
        # `python -m` puts it first; here it is last, and stays for later imports of the plug-in.
        sys.path.append(here)
    try:
        return importlib.import_module(path)
    except ModuleNotFoundError as error:
        if error.name is not None and (path == error.name or path.startswith(error.name + ".")):
            raise PlugInError(
                f"{name}: no module {error.name}, neither installed nor in {here}"
            ) from error
        raise PlugInError(f"{name}: importing {path}: {one_line(error)}") from error
    except (Exception, SystemExit) as error:
        raise PlugInError(f"{name}: importing {path}: {one_line(error)}") from error
