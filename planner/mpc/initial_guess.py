"""Initial guesses of the controls for the MPC: pure pursuit, and the rest of the last plan.

Pure pursuit also drives the legs of recovery manoeuvres, see `planner.safety.plan_choice`.
"""

from __future__ import annotations

import math

import numpy as np

from foresee.mapping.kernels import njit
from planner.motion.dynamics import pose_along
from planner.motion.path import SPACING, project

LOOK = 0.7
"""Distance of the point on a path that pure pursuit aims at, at low speed [m]."""


@njit(cache=True, nogil=True)
def pursue(  # type: ignore[no-untyped-def]
    points, segment, state, stages, dt, v_max, accel, braking, lateral, max_curvature, nearest, free
):
    """Return the controls (stages, 2) of a car that follows a path and stops within `free` [m].

    Pure pursuit (Coulter 1992) gives the curvature. The speed is the highest that keeps to the
    car's limits and lets it stop within `free` and within the plan.

    Args:
        points: points of the path, (n, 2) [m].
        segment: index of the path's segment near which the car is.
        state: x, y, yaw, v of the car, (4,).
        stages: number of steps.
        dt: length of a step [s].
        v_max: top speed [m/s].
        accel: maximum acceleration [m/s²].
        braking: maximum deceleration [m/s²].
        lateral: maximum lateral acceleration [m/s²].
        max_curvature: maximum curvature [1/m].
        nearest: distance of the point to aim at, at least [m].
        free: distance within which the car is to stop [m].
    """
    controls = np.zeros((stages, 2))
    x, y, yaw, v = state[0], state[1], state[2], state[3]
    travelled = 0.0
    for k in range(stages):
        segment, _, _ = project(points, x, y, segment - 3, segment + 12)
        look = max(nearest, 0.4 * v)
        target = min(segment + int(look / SPACING) + 1, points.shape[0] - 1)
        dx, dy = points[target, 0] - x, points[target, 1] - y
        along = dx * math.cos(yaw) + dy * math.sin(yaw)
        across = dy * math.cos(yaw) - dx * math.sin(yaw)
        square = max(dx * dx + dy * dy, 1e-6)
        kappa = 2.0 * across / square
        if along < 0.0:
            kappa = math.copysign(max_curvature, across)
        kappa = min(max(kappa, -max_curvature), max_curvature)
        left = max(free - travelled, 0.0)
        # The highest speed w after this step from which the car can stop within `left`:
        # (v + w)·dt/2 + w²/(2·braking) <= left.
        b = braking * dt
        fastest = 0.5 * (-b + math.sqrt(max(b * b + 4 * (2 * braking * left - b * v), 0.0)))
        curve = math.sqrt(lateral / max(abs(kappa), 1e-6))
        w = min(fastest, curve, v_max, v + accel * dt, braking * dt * (stages - k - 1))
        w = max(w, v - braking * dt, 0.0)
        a = (w - v) / dt
        s = 0.5 * (v + w) * dt
        x, y, yaw = pose_along(x, y, yaw, kappa, s)
        travelled += s
        v = w
        controls[k, 0], controls[k, 1] = a, kappa
    return controls


def shifted(controls: np.ndarray, braking: float) -> np.ndarray:
    """Return the controls of a plan without its first step, and with braking at its end, (N, 2)."""
    return np.vstack([controls[1:], [[-braking, controls[-1, 1]]]])
