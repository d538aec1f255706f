"""First guesses for the MPC: plans that are driven, not optimised."""

from __future__ import annotations

import math

import numpy as np

from planner.motion.dynamics import pose_along
from planner.motion.path import SPACING, project
from predictor.mapping.kernels import njit


@njit(cache=True, nogil=True)
def pursue(points, segment, state, stages, dt, v_max, accel, braking, lateral, max_curvature, free):  # type: ignore[no-untyped-def]
    """Return the controls (stages, 2) of a car that pursues a path and stops after `free` metres.

    Pure pursuit (Coulter 1992) steers; the speed is the highest from which the car still stops
    in time, within the horizon and within the lateral limit.
    """
    controls = np.zeros((stages, 2))
    x, y, yaw, v = state[0], state[1], state[2], state[3]
    travelled = 0.0
    for k in range(stages):
        segment, _, _ = project(points, x, y, segment - 3, segment + 12)
        look = max(0.7, 0.4 * v)
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
        # The fastest next speed w from which braking still ends within what is left:
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
    """Return the controls of a plan one tick later, with braking after its end: (N, 2)."""
    return np.vstack([controls[1:], [[-braking, controls[-1, 1]]]])
