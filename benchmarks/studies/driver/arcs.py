"""Scores of a prediction along arcs that leave the observed space, for `sweeps`."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter

from benchmarks.runs.saved_run import Run
from foresee.infra.command_line import UsageError
from foresee.infra.progress import progress
from foresee.mapping.body import Body, covered
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.grid import Grid
from foresee.prediction import Caller, View
from foresee.statistics import estimate
from planner.motion.dynamics import pose_along
from planner.navigator_config import NavigatorConfig
from predictor.registry import load_predictor

EVERY = 8
"""Number of ticks from one moment at which arcs are swept to the next."""
CURVATURES = (0.0, 0.2, -0.2, 0.5, -0.5, 1.0, -1.0)
"""Curvatures of the arcs [1/m]."""
LENGTH, STEP = 4.6, 0.1
"""Length of an arc, and distance between its poses [m]."""
WIDTH = 5
"""Side of the neighbourhood of the score "least trust around a cell" [cells]."""
SHARES = (0.001, 0.002, 0.005, 0.01, 0.02)
"""Accepted shares of wrong arcs, on which the car would hit something."""
THRESHOLDS = 200
"""Number of thresholds that are tried for each score."""
SCORES = ("least trust of a cell", "least trust around a cell", "independent steps", "union bound")
"""Names of the scores. Trust is confidence · p_free. The last two are probabilities that the whole
swept area is free: the product of the least trusts of all steps, and 1 minus the sum of
(1 - trust) over all cells."""


def reliable_distances(run: Run) -> dict[str, Any]:
    """Return the mean distance beyond the observed space for each score and share of wrong arcs.

    Returns:
        `arcs` and `drives`, their numbers; `scores`: score → for each share in `SHARES` the mean
        distance [m] at the best threshold, with its interval.

    Raises:
        RunError: if the run is damaged.
        UsageError: if it has no drives of the arm `known`, its LIDAR was noisy, or its car is
            not the default one.
    """
    indices = [index for index in run.indices if (index, "known") in run.drives]
    if not indices or run.setting("noise") > 0.0:
        raise UsageError(f"{run.directory}: it must have the arm known, and no noise")
    if run.settings["car"] is not None:
        raise UsageError(f"{run.directory}: it must be of the default car, not of --car")
    caller = Caller(load_predictor(str(run.settings["predictor"])))
    window, expansion = run.setting("window"), run.setting("expansion")
    car = CarLimits(v_max=run.setting("v_max"), braking=run.setting("braking"))
    side = NavigatorConfig(car=car, window=window, expansion=expansion).predicted_side
    arcs: list[NDArray[np.float64]] = []
    worlds: list[str] = []
    for index in progress(indices, desc=run.label, unit="drive"):
        of_drive = _sweep_drive(run, index, caller, side)
        arcs += of_drive
        worlds += [run.drives[index, "known"].world] * len(of_drive)
    if not arcs:
        raise UsageError(f"{run.directory}: no arc leaves the observed space")
    scores = {}
    for number, name in enumerate(SCORES):
        entries = _entries(arcs, 2 + number)
        scores[name] = [
            {"share": share} | estimate(worlds, entries, partial(_farthest, share=share))
            for share in SHARES
        ]
    return {"arcs": len(arcs), "drives": len(indices), "scores": scores}


def _sweep_drive(run: Run, index: int, caller: Caller, side: float) -> list[NDArray[np.float64]]:
    """Return the arcs of a drive that leave the observed space, each as `_swept` returns it."""
    trace, swept = run.trace(index, "known"), []
    for tick in range(0, len(trace.states) - 1, EVERY):
        pose = trace.states[tick, :3].astype(np.float64)
        view = View.of(trace.observed(tick), pose, side, caller.context_side)
        crop, belief = view.known, caller.ask(view)
        trust = np.where(crop.unknown, belief.confidence * belief.p_free, 1.0)
        trusts, free = (trust, minimum_filter(trust, WIDTH)), trace.truth.crop(crop.frame).free
        arcs = (_swept(crop, trusts, free, pose, curvature) for curvature in CURVATURES)
        swept += [arc for arc in arcs if len(arc)]
    return swept


def _swept(
    known: Grid,
    trusts: tuple[NDArray[np.float64], NDArray[np.float64]],
    free: NDArray[np.bool_],
    pose: NDArray[np.float64],
    curvature: float,
) -> NDArray[np.float64]:
    """Sweep the body along an arc, until it overlaps a cell that was observed occupied.

    Args:
        known: observed map.
        trusts: trust of each cell, and the least trust in its neighbourhood, (rows, columns) each.
        free: cells that are free in the true map, (rows, columns).
        pose: x, y, yaw at the beginning of the arc, (3,) [m, m, rad].
        curvature: curvature of the arc [1/m].

    Returns:
        For each pose from the first one on at which the body is not within the observed space:
        distance since then [m], whether the body has hit something by then, and the scores,
        (n, 2 + len(SCORES)).
    """
    trust = trusts[0]
    fresh = np.ones(known.frame.shape, dtype=np.bool_)
    steps, wrong = list[list[float]](), False
    for along in np.arange(0.0, LENGTH, STEP):
        x, y, yaw = pose_along(pose[0], pose[1], pose[2], curvature, along)
        resolution, origin = known.frame.lattice
        cells = covered(known.frame.shape, resolution, origin, x, y, yaw, *Body().halves)
        cells = cells[fresh[cells[:, 0], cells[:, 1]]]
        rows, cols = cells.T
        fresh[rows, cols] = False
        if known.occupied[rows, cols].any():
            break
        unseen = known.unknown[rows, cols]
        rows, cols = rows[unseen], cols[unseen]
        if len(rows) == 0 and not steps:
            continue
        wrong |= not free[rows, cols].all()
        least, near = (float(each[rows, cols].min(initial=1.0)) for each in trusts)
        steps.append([wrong, least, near, least, float((1.0 - trust[rows, cols]).sum())])
    if not steps:
        return np.empty((0, 2 + len(SCORES)))
    wrongs, least, near, product, doubt = np.array(steps, dtype=np.float64).T
    return np.column_stack(
        [
            STEP * np.arange(1, len(steps) + 1),
            wrongs,
            np.minimum.accumulate(least),
            np.minimum.accumulate(near),
            np.cumprod(product),
            1.0 - np.cumsum(doubt),
        ]
    )


def _entries(arcs: list[NDArray[np.float64]], column: int) -> NDArray[np.float64]:
    """Return the entry of each arc in the sums of `_farthest`, (2 * THRESHOLDS + 1, arcs).

    Args:
        arcs: arcs as `_swept` returns them.
        column: column of the score.
    """
    thresholds = np.unique(np.concatenate([arc[:, column] for arc in arcs]))
    thresholds = np.quantile(thresholds, np.linspace(0.0, 1.0, THRESHOLDS))
    sums = np.zeros((2 * THRESHOLDS + 1, len(arcs)))
    sums[-1] = 1.0
    for number, arc in enumerate(arcs):
        # Scores fall along an arc, so that the poses above a threshold can be sums by bisection.
        count = np.searchsorted(-arc[:, column], -thresholds, side="right")
        reached = np.vstack([np.zeros(2), arc[:, :2]])[count]
        sums[:-1, number] = reached.T.ravel()
    return sums


def _farthest(sums: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """Return the largest mean distance [m] at which at most a given share of the arcs is wrong.

    Args:
        sums: distance at each threshold, number of wrong arcs at each threshold, and number of
            arcs, summed over arcs, (2 * THRESHOLDS + 1, rounds).
        share: accepted share of wrong arcs.
    """
    far, wrong = (sums[:-1] / sums[-1]).reshape(2, THRESHOLDS, -1)
    farthest: NDArray[np.float64] = np.where(wrong <= share, far, 0.0).max(axis=0)
    return farthest
