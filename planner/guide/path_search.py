"""The path: Dubins curves along the route, found by OMPL's BIT*."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from planner.motion.path import SPACING, Path
from planner.risk.cost_map import CostMap
from planner.risk.risk_map import RiskMap
from predictor.mapping.car_limits import CarLimits

if TYPE_CHECKING:
    from ompl import base as ob

OUTSIDE_COST = 4.0
"""What a metre outside the map costs the search, twice what one of unknown space does: it keeps to
the map where it can. Of what is found it counts as unknown (`CostMap.along`)."""


@dataclass(frozen=True)
class PathConfig:
    """Settings of the path search.

    Attributes:
        slack: of the curves' turning radius over the car's: leaves it room to correct.
        batch: samples that BIT* draws at a time.
        iterations: of BIT* at most until it has found a path …
        refinements: … and after. Counts, not a time, so that the same input gives the same path.
    """

    slack: float = 1.1
    batch: int = 30
    iterations: int = 80
    refinements: int = 16


def plan_path(
    cost: CostMap,
    near: RiskMap,
    pose: NDArray[np.float64],
    route: NDArray[np.float64],
    ahead: float,
    car: CarLimits,
    config: PathConfig,
    seed: int,
) -> Path | None:
    """The cheapest drivable path from a pose onto the route.

    Args:
        cost: what a metre of way costs, and roughly where the body fits.
        near: says where it fits around the car, to the cell.
        pose: x, y, yaw, (3,).
        route: vertices (n, 2) from near the pose to the goal.
        ahead: how far along the route the curves reach [m]; beyond it the route serves.
        car: what it can do; its body.
        config: settings.
        seed: of the samples.

    Returns:
        The path, all the way to the route's end; None where OMPL found none in its iterations.
    """
    # Here and not above: loading OMPL takes longer than all else that a --help needs.
    from ompl import base as ob
    from ompl import geometric as og
    from ompl import util as ou

    ou.setLogLevel(ou.LogLevel.LOG_NONE)
    # Samplers made from here on draw their seeds from this one. OMPL logs that a seed set late
    # is not deterministic; it is for all generators made after it, and none is kept.
    ou.RNG.setSeed(seed % 2**31 + 1)

    along = Path.through(route, "dijkstra").points
    target = min(len(along) - 1, round(ahead / SPACING))
    space = ob.DubinsStateSpace(config.slack * car.turning_radius)
    bounds = ob.RealVectorBounds(2)
    span = np.vstack([along[: target + 1], pose[None, :2]])
    for axis in (0, 1):
        bounds.setLow(axis, float(span[:, axis].min()) - 3.0)
        bounds.setHigh(axis, float(span[:, axis].max()) + 3.0)
    space.setBounds(bounds)
    info = ob.SpaceInformation(space)

    open_, density = cost.clearance >= cost.required, cost.density
    inverse = 1.0 / cost.frame.resolution
    ox, oy = cost.frame.origin
    rows, cols = cost.frame.shape
    x0, y0 = float(pose[0]), float(pose[1])
    # Two circles cover the body, as in the MPC.
    ends = car.body.length / 4
    around = math.hypot(ends, car.body.half_width) + 0.02
    close = near.obstacle_distance >= around
    near_inverse = 1.0 / near.frame.resolution
    nx, ny = near.frame.origin
    near_rows, near_cols = near.frame.shape

    # Rounded towards zero: less than a cell outside counts as the edge.
    def fits(x: float, y: float) -> bool:
        row, col = int((y - ny) * near_inverse), int((x - nx) * near_inverse)
        if 0 < row < near_rows and 0 < col < near_cols:
            return bool(close[row, col])
        row, col = int((y - oy) * inverse), int((x - ox) * inverse)
        return 0 <= row < rows and 0 <= col < cols and bool(open_[row, col])

    def is_valid(state: ob.State) -> bool:
        x, y, yaw = state.getX(), state.getY(), state.getYaw()
        # The car may start closer to something than it likes; it must be able to leave.
        if (x - x0) ** 2 + (y - y0) ** 2 < 0.2:
            return True
        cos, sin = ends * math.cos(yaw), ends * math.sin(yaw)
        return fits(x + cos, y + sin) and fits(x - cos, y - sin)

    info.setStateValidityChecker(is_valid)
    info.setStateValidityCheckingResolution(0.15 / space.getMaximumExtent())
    info.setup()
    # One serves all: what the binding allocates is never freed.
    scratch = space.allocState()

    class WayCost(ob.OptimizationObjective):
        """The integral of the cost density along a curve."""

        def motionCost(self, a: ob.State, b: ob.State) -> ob.Cost:
            length = space.distance(a, b)
            steps = max(1, math.ceil(length / 0.3))
            total = 0.0
            for i in range(steps):
                space.interpolate(a, b, (i + 0.5) / steps, scratch)
                row = int((scratch.getY() - oy) * inverse)
                col = int((scratch.getX() - ox) * inverse)
                inside = 0 <= row < rows and 0 <= col < cols
                total += density[row, col] if inside else OUTSIDE_COST
            return ob.Cost(float(total) * length / steps)

        def motionCostHeuristic(self, a: ob.State, b: ob.State) -> ob.Cost:
            return ob.Cost(space.distance(a, b))

        def stateCost(self, state: ob.State) -> ob.Cost:
            return ob.Cost(0.0)

    def state(x: float, y: float, yaw: float) -> ob.State:
        # The one there is: to be handed over before the next is asked for. OMPL copies it.
        scratch.setX(float(x))
        scratch.setY(float(y))
        # OMPL's interval is open where ours is closed: +π is outside it.
        scratch.setYaw(float(yaw) if yaw < math.pi else -math.pi)
        return scratch

    problem = ob.ProblemDefinition(info)
    problem.addStartState(state(*pose))
    goals = ob.GoalStates(info)
    back = along[max(0, target - 5)]
    heading = math.atan2(*(along[target] - back)[::-1])
    # At the goal every heading will do; on the way there the route's, roughly.
    turns = np.arange(8) * math.pi / 4 if target == len(along) - 1 else (0.0, 0.35, -0.35)
    for turn in turns:
        yaw = math.remainder(heading + turn, 2 * math.pi)
        goals.addState(state(along[target, 0], along[target, 1], yaw))
    problem.setGoal(goals)
    # The binding does not keep what Python made alive.
    objective = WayCost(info)
    problem.setOptimizationObjective(objective)
    search = og.BITstar(info)
    search.setProblemDefinition(problem)
    search.setSamplesPerBatch(config.batch)
    # With pruning OMPL 2.0.1 reads freed memory now and then on a Dubins space, and crashes.
    search.setPruning(False)
    search.setup()

    search.setStopOnSolnImprovement(True)
    search.solve(_after(config.iterations))
    if problem.hasExactSolution():
        search.setStopOnSolnImprovement(False)
        search.solve(_after(config.refinements))
    if not problem.hasExactSolution():
        return None
    found = problem.getSolutionPath()
    found.interpolate(max(2, math.ceil(found.length() / SPACING)))
    points = np.array([[s.getX(), s.getY()] for s in found.getStates()])
    path = Path.through(np.vstack([points, along[target + 1 :]]), "ompl")
    return replace(path, drivable=min(len(points), len(path.points)))


def _after(count: int) -> ob.PlannerTerminationCondition:
    """A condition that stops a search the `count`-th time that it is asked."""
    from ompl import base as ob

    asked = itertools.count(1)
    return ob.PlannerTerminationCondition(lambda: next(asked) > count)
