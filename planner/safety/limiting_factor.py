"""The limiting factor: what keeps the car from going faster, according to its plan."""

from __future__ import annotations

import math
from enum import StrEnum

import numpy as np

from foresee.mapping.car_limits import CarLimits
from planner.motion.goal import STOP_GOAL_RADIUS
from planner.motion.plan import Plan
from planner.risk.risk_map import RiskMap


class Limit(StrEnum):
    """Why the car does not go faster."""

    TOP_SPEED = "top speed"
    ACCELERATION = "acceleration"
    TURN = "turn"
    GOAL = "goal"
    UNSEEN = "unseen space"
    OBSTACLE = "obstacle"
    PATH = "path"
    EMERGENCY = "emergency"


def what_limits(
    plan: Plan, risk: RiskMap, goal: tuple[float, float], car: CarLimits, emergency: bool
) -> Limit:
    """Return what keeps the car from going faster: the first limit that applies to its plan.

    Args:
        plan: plan that the car drives.
        risk: risk map on which the plan was tested.
        goal: x, y of the goal [m].
        car: the car's limits and body.
        emergency: whether no plan is safe.
    """
    v, a = plan.states[0, 3], plan.controls[0, 0]
    if emergency:
        return Limit.EMERGENCY
    if v >= 0.98 * car.v_max:
        return Limit.TOP_SPEED
    if a >= 0.9 * car.acceleration:
        return Limit.ACCELERATION
    x, y, yaw = plan.states[-1, :3]
    if math.hypot(x - goal[0], y - goal[1]) < STOP_GOAL_RADIUS:
        return Limit.GOAL
    near = slice(0, 12)
    lateral = plan.states[:-1, 3][near] ** 2 * np.abs(plan.controls[:, 1][near])
    if lateral.max() >= 0.95 * car.lateral_acceleration:
        return Limit.TURN
    if np.abs(plan.controls[:8, 1]).max() >= 0.98 * car.max_curvature and v > 0.1:
        return Limit.TURN
    # The cells just ahead of the body at the plan's end.
    front = car.body.half_length + 0.3
    row, col = risk.frame.cell(x + front * math.cos(yaw), y + front * math.sin(yaw))
    reach = math.ceil((car.body.half_width + 0.2) / risk.frame.resolution)
    ahead = (
        slice(max(0, row - reach), row + reach + 1),
        slice(max(0, col - reach), col + reach + 1),
    )
    unsafe = ~risk.safe[ahead]
    if not unsafe.any():
        return Limit.PATH
    seen = (unsafe & risk.known.occupied[ahead]).any()
    unseen = (unsafe & risk.known.unknown[ahead]).sum()
    return Limit.UNSEEN if unseen > 8 or not seen else Limit.OBSTACLE
