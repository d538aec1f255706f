"""References of the MPC's cost: where on the path each state should be."""

from __future__ import annotations

import math

import numpy as np

from foresee.mapping.kernels import njit
from planner.motion.path import project

NEAR_END = 3.0
"""Length of the last part of a path, which the MPC follows more closely [m]."""


@njit(cache=True, nogil=True)
def references(points, start, states, reach, weights):  # type: ignore[no-untyped-def]
    """Compute the reference of each state on the path, for `planner.mpc.stages.stage_functions`.

    Progress is the arc length of the projection; its gradient is the path's tangent. Beyond the
    path's end, states are pulled towards its last point. Each state is projected near the
    projection of the state before, so that a path that crosses itself is followed in order.

    Args:
        points: points of the path, evenly spaced, (n, 2) [m].
        start: index of the segment near which the first state is projected.
        states: x, y, yaw, v of the states, (m, 4).
        reach: number of segments that one step may advance.
        weights: `Weights` of the cost.

    Returns:
        References (m, 9), and the cost of each state, (m,).
    """
    contour, progress = weights.contour, weights.progress
    count = states.shape[0]
    out = np.zeros((count, 9))
    costs = np.empty(count)
    last = points.shape[0] - 2
    spacing = math.hypot(points[1, 0] - points[0, 0], points[1, 1] - points[0, 1])
    here = start
    for k in range(count):
        x, y = states[k, 0], states[k, 1]
        here, t, square = project(points, x, y, here - reach // 2, here + reach)
        ax, ay = points[here, 0], points[here, 1]
        dx, dy = points[here + 1, 0] - ax, points[here + 1, 1] - ay
        length = max(math.hypot(dx, dy), 1e-9)
        tx, ty = dx / length, dy / length
        out[k, 0], out[k, 1] = ax + t * dx, ay + t * dy
        # At the path's end precision counts: a car that misses the goal has to turn round.
        left = (last + 1 - here - t) * spacing
        end = max(0.0, 1.0 - left / NEAR_END)
        weight = contour + (weights.final_contour - contour) * end
        if k == count - 1:
            weight = weights.final_contour
        costs[k] = -progress * (here + t) * spacing + 0.5 * weight * square
        if here == last and t >= 1.0:
            out[k, 4] = out[k, 6] = weight
        else:
            out[k, 2], out[k, 3] = -progress * tx, -progress * ty
            out[k, 4] = weight * ty * ty
            out[k, 5] = -weight * tx * ty
            out[k, 6] = weight * tx * tx
        if k == count - 1 and here < last:
            out[k, 7], out[k, 8] = math.atan2(ty, tx), weights.final_heading
            costs[k] += weights.final_heading * (1.0 - math.cos(states[k, 2] - out[k, 7]))
    return out, costs
