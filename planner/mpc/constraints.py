"""Kernels for the constraints of the SQP's dense QP: the car's limits, v_N = 0, and clearance.

The variables have the order of `planner.mpc.condense`.
"""

from __future__ import annotations

import numpy as np

from foresee.mapping.kernels import njit


@njit(cache=True, nogil=True)
def nearby(value, limit):  # type: ignore[no-untyped-def]
    """Return index of state and of circle, (n, 2), for each clearance below a limit [m].

    The first state is left out, since no control changes it.
    """
    which = np.empty((value.size, 2), dtype=np.int64)
    count = 0
    for k in range(1, value.shape[0]):
        for i in range(2):
            if value[k, i] < limit:
                which[count, 0], which[count, 1] = k, i
                count += 1
    return which[:count]


@njit(cache=True, nogil=True)
def rows(sensitivity, states, controls, normal, near, dt):  # type: ignore[no-untyped-def]
    """Compute the matrix of the QP's constraints: limits of the car, v_N = 0, clearance (soft).

    Args:
        sensitivity: derivatives of the states with respect to the controls, (N+1, 4, 2N).
        states: states at which the QP is linearised, (N+1, 4).
        controls: controls at which it is linearised, (N, 2).
        normal: gradients of the clearances with respect to x, y, yaw, (N+1, 2, 3).
        near: clearances that have a row, (n, 2), from `nearby`.
        dt: length of a step [s].

    Returns:
        Matrix (2N + n, 2N), with the rows v_1 … v_N, lateral acceleration in the steps 0 … N-1,
        and clearances; and daqp's `sense` (4N + n,) int32, in which the variables come first.
    """
    n = controls.shape[0]
    size = 2 * n
    a = np.zeros((size + near.shape[0], size))
    sense = np.zeros(2 * size + near.shape[0], dtype=np.int32)
    for k in range(n):
        for j in range(k + 1):
            a[k, 2 * j] = dt
    # In daqp, 5 marks an equality, and 8 a soft constraint.
    sense[size + n - 1] = 5
    for k in range(n):
        end = _faster_end(controls, k)
        v, kappa = states[end, 3], controls[k, 1]
        for j in range(end):
            a[n + k, 2 * j] = 2 * v * kappa * dt
        a[n + k, 2 * k + 1] = v * v
    for r in range(near.shape[0]):
        k, i = near[r, 0], near[r, 1]
        for j in range(2 * k):
            total = 0.0
            for m in range(3):
                total += normal[k, i, m] * sensitivity[k, m, j]
            a[size + r, j] = total
        sense[2 * size + r] = 8
    return a, sense


@njit(cache=True, nogil=True, inline="always")
def _faster_end(controls, k):  # type: ignore[no-untyped-def]
    """Return the index of the state at a step's faster end, where lateral acceleration peaks."""
    return k + 1 if controls[k, 0] > 0 else k


@njit(cache=True, nogil=True)
def bounds(states, controls, lacking, dt, limits, trust):  # type: ignore[no-untyped-def]
    """Compute the lower and upper bounds of the QP's variables and constraints, (4N + n,) each.

    The variables come first, and then the rows of `rows`. In a second step the matrix is still that
    of the first, so that these bounds ensure the limits to first order only.

    Args:
        states: current states, (N+1, 4).
        controls: current controls, (N, 2).
        lacking: required clearance less each of those that have a row, (n,) [m].
        dt: length of a step [s].
        limits: the car's `DrivingLimits`.
        trust: maximum change of each curvature [1/m].
    """
    n = controls.shape[0]
    size = 2 * n
    lower = np.empty(2 * size + lacking.size)
    upper = np.full(2 * size + lacking.size, 1e30)
    for k in range(n):
        lower[2 * k] = -limits.braking - controls[k, 0]
        upper[2 * k] = limits.acceleration - controls[k, 0]
        lower[2 * k + 1] = max(-limits.curvature - controls[k, 1], -trust)
        upper[2 * k + 1] = min(limits.curvature - controls[k, 1], trust)
        # A car that is measured above v_max must still have a plan: it may brake down to it.
        top = max(limits.v_max, states[0, 3] - limits.braking * dt * (k + 1))
        lower[size + k] = -states[k + 1, 3]
        upper[size + k] = top - states[k + 1, 3]
        end = _faster_end(controls, k)
        now = states[end, 3] ** 2 * controls[k, 1]
        lower[size + n + k] = min(-limits.cornering - now, 0.0)
        upper[size + n + k] = max(limits.cornering - now, 0.0)
    lower[size + n - 1] = upper[size + n - 1] = -states[n, 3]
    lower[2 * size :] = lacking
    return lower, upper
