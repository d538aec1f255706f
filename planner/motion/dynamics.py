"""The planner's model of the car: a Dubins car with bounded acceleration.

The state is [x, y, yaw, v] [m, m, rad, m/s], the control [a, κ] [m/s², 1/m]: acceleration and
curvature. With a and κ held over a step the car drives along a circular arc, so the step has a
closed form and needs no integrator: with s = v·dt + a·dt²/2,

    p' = p + s · sinc(κs/2) · (cos(yaw + κs/2), sin(yaw + κs/2))
    yaw' = yaw + κs
    v' = v + a·dt.

`planner.mpc.stages` has the derivatives of a step for the MPC.
"""

from __future__ import annotations

import math

import numpy as np

from foresee.mapping.kernels import njit


@njit(cache=True, nogil=True)
def rollout(state, controls, dt, limits):  # type: ignore[no-untyped-def]
    """Simulate the car under given controls, clipped to its limits.

    Args:
        state: x, y, yaw, v at the start, (4,).
        controls: a, κ of each step, (N, 2).
        dt: length of a step [s].
        limits: the car's `DrivingLimits`.

    Returns:
        States (N+1, 4) and clipped controls (N, 2).
    """
    stages = controls.shape[0]
    states = np.empty((stages + 1, 4))
    applied = np.empty((stages, 2))
    states[0] = state
    for k in range(stages):
        x, y, yaw, v = states[k, 0], states[k, 1], states[k, 2], states[k, 3]
        a = min(max(controls[k, 0], -limits.braking), limits.acceleration)
        a = min(max(a, -v / dt), max((limits.v_max - v) / dt, -limits.braking))
        fastest = max(v, v + a * dt)
        bound = min(limits.curvature, limits.cornering / max(fastest * fastest, 1e-9))
        kappa = min(max(controls[k, 1], -bound), bound)
        s = v * dt + 0.5 * a * dt * dt
        states[k + 1, :3] = pose_along(x, y, yaw, kappa, s) if s != 0.0 else (x, y, yaw)
        states[k + 1, 3] = max(v + a * dt, 0.0)
        applied[k, 0], applied[k, 1] = a, kappa
    return states, applied


@njit(cache=True, nogil=True, inline="always")
def pose_along(x, y, yaw, kappa, part):  # type: ignore[no-untyped-def]
    """Return x, y, yaw after a length `part` [m] of the arc from a pose with curvature κ [1/m]."""
    half = 0.5 * kappa * part
    chord = part * (math.sin(half) / half if abs(half) > 1e-8 else 1.0)
    return x + chord * math.cos(yaw + half), y + chord * math.sin(yaw + half), yaw + 2 * half


@njit(cache=True, nogil=True)
def swept(states, controls, dt, spacing):  # type: ignore[no-untyped-def]
    """Return poses x, y, yaw (n, 3) along a plan, at most `spacing` [m] apart, from its start on.

    `spacing` is measured along the path of the body's centre; in a turn, the corners move farther.
    """
    stages = controls.shape[0]
    counts = np.empty(stages, dtype=np.int64)
    for k in range(stages):
        s = states[k, 3] * dt + 0.5 * controls[k, 0] * dt * dt
        counts[k] = math.ceil(s / spacing) if s > 1e-6 else 0
    poses = np.empty((1 + counts.sum(), 3))
    poses[0] = states[0, :3]
    i = 1
    for k in range(stages):
        s = states[k, 3] * dt + 0.5 * controls[k, 0] * dt * dt
        x, y, yaw, kappa = states[k, 0], states[k, 1], states[k, 2], controls[k, 1]
        for j in range(1, counts[k] + 1):
            poses[i] = pose_along(x, y, yaw, kappa, s * j / counts[k])
            i += 1
    return poses
