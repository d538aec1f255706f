"""Provenance of a predictor, from the facts of its training that a learned one carries."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.grid import world_hash


def weights_fingerprint(predictor: Any) -> str | None:
    """Return the fingerprint of a predictor's weights and its runtime; None if it has none.

    The runtime is included because it decides the last digits, on which a drive may depend.
    """
    facts = _facts(predictor)
    identity = [facts[name] for name in ("fingerprint", "runtime") if name in facts]
    return " on ".join(map(str, identity)) or None


def has_learned(predictor: Any, cells: NDArray[np.int8]) -> bool:
    """Return whether a predictor was trained or validated on a building, according to its facts."""
    facts, building = _facts(predictor), world_hash(cells)
    worlds = [facts.get(name) for name in ("worlds", "validation_worlds")]
    return any(building in these for these in worlds if isinstance(these, Collection))


def _facts(predictor: Any) -> dict[str, Any]:
    facts = getattr(predictor, "facts", {})
    return facts if isinstance(facts, dict) else {}
