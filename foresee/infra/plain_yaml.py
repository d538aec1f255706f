"""YAML from untrusted files: plain values only, so that a small file stays small in memory."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from foresee.infra.errors import LineError
from foresee.infra.input_file import read_input

LONGEST = 4000
"""Longest scalar allowed [characters]; a longer number would take seconds to parse."""
DEEPEST = 40
"""Deepest nesting allowed."""
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class YamlError(LineError):
    """A YAML file is invalid, too large, or uses something that is refused."""


def read_yaml(path: Path, most: int) -> Any:
    """Read a YAML file of plain values.

    Anchors, aliases and merge keys are refused, since a few hundred bytes of them can expand to
    gigabytes.

    Args:
        path: path of the file.
        most: largest size allowed [bytes]; a larger file is not parsed.

    Raises:
        OSError: if the file cannot be read.
        YamlError: if it is no regular file, too large, not valid YAML, or uses something that is
            refused.
    """
    try:
        data = read_input(path, most)
    except ValueError as error:
        raise YamlError(str(error)) from None
    try:
        text = data.decode("utf-8-sig")
        _refuse(text)
        return yaml.load(text, Loader=LOADER)
    except YamlError:
        raise
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise YamlError(f"not valid YAML: {error}") from error


def _refuse(text: str) -> None:
    """Raise YamlError if a text has anchors, aliases, merge keys, or too deep or long values."""
    depth = 0
    for event in yaml.parse(text, Loader=LOADER):
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
            raise YamlError("it uses anchors and aliases, which are not supported")
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > DEEPEST:
            raise YamlError(f"it is nested more than {DEEPEST} deep")
        if isinstance(event, yaml.ScalarEvent):
            if len(event.value) > LONGEST:
                raise YamlError(f"it holds a value of over {LONGEST} characters")
            if event.value == "<<" and event.implicit[0]:
                raise YamlError("it uses merge keys, which are not supported")
