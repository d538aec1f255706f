"""Pure pursuit (Coulter 1992): the arc that leads a car to a point."""

from __future__ import annotations

import math

from foresee.mapping.kernels import njit


@njit(cache=True, nogil=True)
def steer(x, y, yaw, target, most):  # type: ignore[no-untyped-def]
    """Return the curvature of the arc to a point [1/m]; the tightest one to a point behind.

    Args:
        x: x of the car [m].
        y: y of the car [m].
        yaw: heading of the car [rad].
        target: x, y of the point, (2,) [m].
        most: maximum curvature [1/m].
    """
    dx, dy = target[0] - x, target[1] - y
    along = dx * math.cos(yaw) + dy * math.sin(yaw)
    across = dy * math.cos(yaw) - dx * math.sin(yaw)
    kappa = 2.0 * across / max(dx * dx + dy * dy, 1e-6)
    if along < 0.0:
        kappa = math.copysign(most, across)
    return min(max(kappa, -most), most)
