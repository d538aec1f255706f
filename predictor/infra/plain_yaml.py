"""YAML from strangers: plain values, without what makes a small file large in memory."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from predictor.infra.errors import LineError

LONGEST = 4000
"""Longer scalars are refused [characters]: a number of that many digits takes seconds."""
DEEPEST = 40
"""Deeper nesting is refused."""
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class YamlError(LineError):
    """A YAML file that cannot be read, or that uses what is refused."""


def read_yaml(path: Path, most: int) -> Any:
    """Read a YAML file of plain values.

    Anchors, aliases and merge keys are refused: a few hundred bytes of them expand without end.

    Args:
        path: of the file.
        most: bytes; a larger file is refused before it is read.

    Raises:
        OSError: if it cannot be read.
        YamlError: if it is too large, no YAML, or uses what is refused.
    """
    with path.open("rb") as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise YamlError(f"it has over {most} bytes")
    try:
        text = data.decode("utf-8-sig")
        _refuse(text)
        return yaml.load(text, Loader=LOADER)
    except YamlError:
        raise
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise YamlError(f"not valid YAML: {error}") from error


def _refuse(text: str) -> None:
    """Raise if a text uses what is refused."""
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
