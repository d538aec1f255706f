"""Provenance of a predictor, from the facts of its training that a learned one carries."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foresee.infra.errors import one_line
from foresee.mapping.grid import world_hash
from predictor.weights import WeightsError


def weights_fingerprint(predictor: Any) -> str | None:
    """Return the fingerprint of the weights of a predictor or driver; None if it has none.

    It is that of its `facts`, with the runtime, which decides the last digits, on which a drive may
    depend. Without them, it is the SHA-256 hash of the file that its attribute `weights` names, if
    that is a `Path` or a string.

    Raises:
        WeightsError: if that file cannot be read.
    """
    facts = _facts(predictor)
    identity = [facts[name] for name in ("fingerprint", "runtime") if name in facts]
    weights = getattr(predictor, "weights", None)
    if identity or not isinstance(weights, Path | str):
        return " on ".join(map(str, identity)) or None
    try:
        return hashlib.sha256(Path(weights).read_bytes()).hexdigest()
    except OSError as error:
        raise WeightsError(f"weights {weights} cannot be read: {one_line(error)}") from error


def has_learned(predictor: Any, forms: Iterable[NDArray[np.int8]]) -> bool:
    """Return whether a predictor was trained or validated on a building, according to its facts.

    Args:
        predictor: predictor or driver.
        forms: cells of the building's map, in each form in which it may have been learned; see
            `sim.buildings.learned_forms`. Nothing is asked for if the facts name no buildings.
    """
    facts = _facts(predictor)
    worlds = [facts.get(name) for name in ("worlds", "validation_worlds")]
    lists = [these for these in worlds if isinstance(these, Collection) and these]
    return bool(lists) and any(world_hash(cells) in these for cells in forms for these in lists)


def _facts(predictor: Any) -> dict[str, Any]:
    facts = getattr(predictor, "facts", {})
    return facts if isinstance(facts, dict) else {}
