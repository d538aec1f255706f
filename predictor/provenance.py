"""Where a predictor comes from, as far as it says: a learned one carries facts of its training."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from predictor.mapping.grid import world_hash


def fingerprint_of(predictor: Any) -> str | None:
    """Of a predictor's weights, and what runs them; None if it says nothing of any.

    The runtime belongs to it: its last digits are its own, and a drive may turn upon them.
    """
    facts = _facts(predictor)
    found = [facts[name] for name in ("fingerprint", "runtime") if name in facts]
    return " on ".join(map(str, found)) or None


def has_learned(predictor: Any, cells: NDArray[np.int8]) -> bool:
    """Whether a predictor says that it was trained or tuned on a building."""
    facts = _facts(predictor)
    return any(world_hash(cells) in facts.get(name, ()) for name in ("worlds", "validation_worlds"))


def _facts(predictor: Any) -> dict[str, Any]:
    facts = getattr(predictor, "facts", {})
    return facts if isinstance(facts, dict) else {}
