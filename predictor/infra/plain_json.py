"""JSON from strangers: as `json.loads`, but what is nested too deep is a ValueError too."""

from __future__ import annotations

import json
from typing import Any


def loads(text: str | bytes) -> Any:
    """Return the value of a text.

    Raises:
        ValueError: if it is no JSON, or nested deeper than Python can follow.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deep") from None
