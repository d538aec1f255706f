"""A turn on the spot: where to, and whether the body meets nothing on it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.body import Scene, first_contact
from foresee.mapping.car_limits import CONTACT_MARGIN, JUDGE_MARGIN, CarLimits
from foresee.mapping.conventions import REST, TICK
from planner.risk.risk_map import RiskMap

LOOK = 1.0
"""Distance along a route of the point that the car turns towards [m]."""
TURNED = 0.02
"""Angle within which a turn has ended [rad]."""


def angle_to(route: NDArray[np.float64], pose: NDArray[np.float64]) -> float:
    """Return the angle from the heading of a pose to a route that begins there, in [−π, π] [rad].

    Args:
        route: points of the route, (n, 2) [m].
        pose: x, y, yaw, (3,) or more.
    """
    off = route - pose[:2]
    far = np.flatnonzero(np.hypot(*off.T) >= LOOK)
    dx, dy = off[far[0] if len(far) else -1]
    return math.remainder(math.atan2(dy, dx) - float(pose[2]), 2.0 * math.pi)


def can_turn(pose: NDArray[np.float64], angle: float, risk: RiskMap, car: CarLimits) -> bool:
    """Return whether the body stays in cells that were observed free on a turn on the spot.

    The body is tested at yaws so close to each other that the margin covers the motion between
    them, as `CarLimits.spacing` does for poses along an arc.

    Args:
        pose: x, y, yaw at which the turn begins, (3,) or more.
        angle: angle of the turn, positive to the left [rad].
        risk: newest risk map around the car.
        car: body of the car.
    """
    body = car.body.inflated(CONTACT_MARGIN)
    scene = Scene(~risk.known.free, *risk.frame.lattice, *body.halves)
    step = 2.0 * (CONTACT_MARGIN - JUDGE_MARGIN) / car.body.radius
    count = max(1, math.ceil(abs(angle) / step))
    poses = np.tile(np.asarray(pose, dtype=np.float64)[:3], (count + 1, 1))
    poses[:, 2] += angle * np.arange(count + 1) / count
    return bool(first_contact(scene, poses) < 0)


def longest_turn(angle: float, car: CarLimits) -> int:
    """Return how many ticks a turn may take: twice as many as at the full yaw rate, and a second.

    Args:
        angle: angle of the turn [rad].
        car: limits of the car.
    """
    return math.ceil((2.0 * abs(angle) / car.turn_rate + 1.0) / TICK)


def rate_towards(yaw: float, state: NDArray[np.float64], risk: RiskMap, car: CarLimits) -> float:
    """Return the yaw rate of the next tick of a turn on the spot [rad/s]; 0: the turn has ended.

    It ends at its yaw, or as soon as the car moves or the rest of it is not observed to be free.

    Args:
        yaw: yaw at which the turn ends [rad].
        state: current x, y, yaw, v of the car, (4,).
        risk: newest risk map around the car.
        car: limits and body of the car.
    """
    left = math.remainder(yaw - float(state[2]), 2.0 * math.pi)
    if abs(left) <= TURNED or abs(state[3]) > REST or not can_turn(state, left, risk, car):
        return 0.0
    return min(max(left / TICK, -car.turn_rate), car.turn_rate)
