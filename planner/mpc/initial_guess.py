"""Initial guesses of the controls for the MPC: pure pursuit, and the rest of the last plan.

Pure pursuit also drives the legs of recovery manoeuvres, see `planner.safety.plan_choice`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.kernels import njit
from planner.motion.dynamics import pose_along
from planner.motion.path import POINT_SPACING, project
from planner.motion.pure_pursuit import steer

LOOK = 0.7
"""Distance of the point on a path that pure pursuit aims at, at low speed [m]."""


@njit(cache=True, nogil=True)
def pursue(points, segment, state, stages, dt, limits, look, free):  # type: ignore[no-untyped-def]
    """Return the controls (stages, 2) of a car that follows a path and stops within `free` [m].

    Pure pursuit (Coulter 1992) gives the curvature. The speed is the highest that keeps to the
    car's limits and lets it stop within `free` and within the plan.

    Args:
        points: points of the path, (n, 2) [m].
        segment: index of the path's segment near which the car is.
        state: x, y, yaw, v of the car, (4,).
        stages: number of steps.
        dt: length of a step [s].
        limits: the car's `DrivingLimits`.
        look: distance of the point to aim at, at least [m].
        free: distance within which the car is to stop [m].
    """
    controls = np.zeros((stages, 2))
    braking = limits.braking
    x, y, yaw, v = state[0], state[1], state[2], state[3]
    travelled = 0.0
    for k in range(stages):
        segment, _, _ = project(points, x, y, segment - 3, segment + 12)
        target = min(segment + int(max(look, 0.4 * v) / POINT_SPACING) + 1, points.shape[0] - 1)
        kappa = steer(x, y, yaw, points[target], limits.curvature)
        left = max(free - travelled, 0.0)
        # The highest speed w after this step from which the car can stop within `left`:
        # (v + w)·dt/2 + w²/(2·braking) <= left.
        b = braking * dt
        fastest = 0.5 * (-b + math.sqrt(max(b * b + 4 * (2 * braking * left - b * v), 0.0)))
        curve = math.sqrt(limits.cornering / max(abs(kappa), 1e-6))
        gained = v + limits.acceleration * dt
        w = min(fastest, curve, limits.v_max, gained, braking * dt * (stages - k - 1))
        w = max(w, v - braking * dt, 0.0)
        a = (w - v) / dt
        s = 0.5 * (v + w) * dt
        x, y, yaw = pose_along(x, y, yaw, kappa, s)
        travelled += s
        v = w
        controls[k, 0], controls[k, 1] = a, kappa
    return controls


def shifted(controls: NDArray[np.float64], braking: float) -> NDArray[np.float64]:
    """Return the controls of a plan without its first step, and with braking at its end, (N, 2)."""
    return np.vstack([controls[1:], [[-braking, controls[-1, 1]]]])


def stop_controls(stages: int, braking: float, curvature: float) -> NDArray[np.float64]:
    """Return controls (stages, 2) that brake as hard as the car can, on a curvature [1/m]."""
    return np.tile([-braking, curvature], (stages, 1))
