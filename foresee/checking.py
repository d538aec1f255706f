"""The rules that `predictor.check` tests, for the authors of plug-ins."""

from __future__ import annotations

import time
from copy import deepcopy

import numpy as np

from foresee.infra.float_errors import usual_float_errors
from foresee.mapping.conventions import RESOLUTION, TICK
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from foresee.prediction import BadPredictionError, Caller, Prediction, Predictor, View

CERTAIN = 1.0 - 1e-6
"""Confidence times probability from which on a cell counts as certain."""
FIELDS = ("p_free", "p_occupied", "confidence")


@usual_float_errors()
def check_predictor(predictor: Predictor, *, side: float = 10.0, seed: int = 0) -> tuple[str, ...]:
    """Check that a predictor keeps to the contract with the planner.

    It is asked about an empty, an unknown and a cluttered map, in several poses and in two sizes,
    or in the one that it states, each twice in a row, and then about all of them again in the
    opposite order.

    Args:
        predictor: predictor to check.
        side: side of the larger maps [m], for a predictor that states no side.
        seed: seed of the maps.

    Returns:
        Warnings about what the contract allows but what makes drives slower or hard to repeat, one
        line each, with the remedy.

    Raises:
        BadPredictionError: if the predictor breaks the contract; the message names the remedy.
    """
    caller = Caller(predictor)
    sides = (caller.side,) if caller.side else (side, 0.55 * side)
    views = _views(sides, caller.context_side, seed)
    warnings: dict[str, str] = {}
    if caller.is_old:
        warnings["old"] = (
            "predict(known, pose) will not work in version 2: make it predict(view), where "
            "view.known and view.pose are the same"
        )
    answers, times = [], []
    for view in views:
        known = view.known
        answer, first = _ask(caller, view)
        again, second = _ask(caller, view)
        # The shorter one, since other programs delay single calls.
        times.append(min(first, second))
        if not _same(answer, again):
            raise BadPredictionError("predict() gave two answers to one question")
        if answer.nan_cells:
            if answer.nan_cells == known.unknown.sum():
                raise BadPredictionError("predict() gave NaN in every cell that was not seen")
            warnings["nan"] = (
                f"NaN in {answer.nan_cells} of {known.unknown.sum()} cells not seen: they count as "
                "unknown, return a confidence of 0 in their place"
            )
        certainty = answer.confidence * np.maximum(answer.p_free, answer.p_occupied)
        certain = int((known.unknown & (certainty >= CERTAIN)).sum())
        if certain:
            warnings["certain"] = (
                f"certainty about {certain} cells that were not seen: the car may rely on them, "
                "and brakes hard where it is wrong; return a calibrated confidence below 1"
            )
        answers.append(answer)
    slowest = max(times)
    if slowest > TICK:
        warnings["late"] = (
            f"an answer took {slowest:.2f} s, a tick is {TICK:g} s: it delays every "
            "control, and one that takes too long is not used; make it faster, or the square "
            "smaller (expansion, or its side)"
        )
    for view, answer in reversed(list(zip(views, answers, strict=True))):
        if not _same(answer, _ask(caller, view)[0]):
            warnings["memory"] = (
                "the answer depends on what was asked before: a drive may then depend on the "
                "building driven before it; keep no state, or forget it in a new building"
            )
    return tuple(warnings.values())


def _views(sides: tuple[float, ...], context_side: float, seed: int) -> list[View]:
    """Return views of maps of each size [m]."""
    rng = np.random.default_rng(seed)
    views = []
    for length in sides:
        n = round(length / RESOLUTION)
        clutter = rng.choice(np.array([FREE, FREE, OCCUPIED, UNKNOWN], np.int8), size=(n, n))
        for cells in (
            np.full((n, n), FREE, np.int8),
            np.full((n, n), UNKNOWN, np.int8),
            clutter,
        ):
            origin = (float(rng.integers(-9, 9)), float(rng.integers(-9, 9)))
            known = Grid(GridFrame(RESOLUTION, origin, (n, n)), cells)
            pose = np.array([*known.frame.centre(n / 2, n / 2), rng.uniform(-np.pi, np.pi)])
            views.append(View.of(known, pose, length, context_side))
    return views


def _ask(caller: Caller, view: View) -> tuple[Prediction, float]:
    """Return a checked answer, and the time that it took [s]."""
    given = deepcopy(view)
    maps = ((given.known, view.known), (given.around, view.around))
    pose = given.pose
    started = time.perf_counter()
    answer = caller.ask(view, given)
    seconds = time.perf_counter() - started
    if any(not np.array_equal(a.cells, b.cells) or a.frame != b.frame for a, b in maps):
        raise BadPredictionError("predict() changed the map that it was given: copy it first")
    if not np.array_equal(pose, view.pose):
        raise BadPredictionError("predict() changed the pose that it was given: copy it first")
    return answer, seconds


def _same(first: Prediction, second: Prediction) -> bool:
    alike = (np.array_equal(getattr(first, name), getattr(second, name)) for name in FIELDS)
    return first.doubt == second.doubt and all(alike)
