"""Path search with OMPL: BIT* over Dubins curves along the route."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.body import Body
from foresee.mapping.car_limits import CarLimits
from planner.guide.elastic_band import BODY_MARGIN
from planner.motion.path import POINT_SPACING, Path
from planner.risk.cost_map import CostMap
from planner.risk.risk_map import RiskMap

if TYPE_CHECKING:
    from ompl import base as ob

OUTSIDE_COST = 4.0
"""Cost of a metre outside the map during the search, in metres of free space. It is above that of
unobserved space, so that the search keeps to the map where it can. The price of a path
(`CostMap.along`) treats the outside as unobserved space."""


@dataclass(frozen=True)
class PathConfig:
    """Settings of the search with OMPL.

    Attributes:
        slack: ratio of the curves' turning radius to the car's; it leaves the car room to correct
            errors.
        batch: number of samples that BIT* draws at a time.
        iterations: maximum number of iterations of BIT* until it finds a path. It is not a time,
            so that the same input gives the same path.
        refinements: number of further iterations, which improve the path.
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
    """Find the cheapest drivable path from a pose onto the route.

    Args:
        cost: cost map of the whole map.
        near: risk map around the car, whose finer cells decide there whether the body fits.
        pose: x, y, yaw at the start, (3,).
        route: vertices of the route from near the pose to the goal, (n, 2) [m].
        ahead: distance along the route that the curves reach [m]; beyond it the path is the route.
        car: the car's limits and body.
        config: settings of the search.
        seed: seed of the samples.

    Returns:
        The path to the route's end; None if OMPL finds none in its iterations.
    """
    # Imported here: loading OMPL takes longer than all else that a --help needs.
    from ompl import base as ob

    _set_seed(seed)
    along = Path.through(route, "dijkstra").points
    target = min(len(along) - 1, round(ahead / POINT_SPACING))
    space = _space(
        config.slack * car.turning_radius, np.vstack([along[: target + 1], pose[None, :2]])
    )
    info = ob.SpaceInformation(space)
    info.setStateValidityChecker(_validity(cost, near, pose, car.body))
    info.setStateValidityCheckingResolution(0.15 / space.getMaximumExtent())
    info.setup()
    # One state is reused everywhere, since the binding never frees what it allocates.
    scratch = space.allocState()

    problem = ob.ProblemDefinition(info)
    problem.addStartState(_filled(scratch, *pose))
    goals = ob.GoalStates(info)
    for goal in _goal_poses(along, target):
        goals.addState(_filled(scratch, *goal))
    problem.setGoal(goals)
    # Held in a variable, since the binding does not keep Python's objects alive.
    objective = _path_cost(info, space, scratch, cost)
    problem.setOptimizationObjective(objective)
    _solve(info, problem, config)
    if not problem.hasExactSolution():
        return None
    solution = problem.getSolutionPath()
    solution.interpolate(max(2, math.ceil(solution.length() / POINT_SPACING)))
    points = np.array([[s.getX(), s.getY()] for s in solution.getStates()])
    path = Path.through(np.vstack([points, along[target + 1 :]]), "ompl")
    return replace(path, drivable=min(len(points), len(path.points)))


def _set_seed(seed: int) -> None:
    """Seed the samplers that OMPL makes from now on, and turn off its log."""
    from ompl import util as ou

    ou.setLogLevel(ou.LogLevel.LOG_NONE)
    # OMPL warns that a seed set so late does not make results deterministic. Here it does, since no
    # generator that was made before is used.
    ou.RNG.setSeed(seed % 2**31 + 1)


def _space(radius: float, span: NDArray[np.float64]) -> ob.DubinsStateSpace:
    """Return the Dubins space of a turning radius [m], bounded 3 m around some points (n, 2)."""
    from ompl import base as ob

    space = ob.DubinsStateSpace(radius)
    bounds = ob.RealVectorBounds(2)
    for axis in (0, 1):
        bounds.setLow(axis, float(span[:, axis].min()) - 3.0)
        bounds.setHigh(axis, float(span[:, axis].max()) + 3.0)
    space.setBounds(bounds)
    return space


def _validity(
    cost: CostMap, near: RiskMap, pose: NDArray[np.float64], body: Body
) -> Callable[[ob.State], bool]:
    """Return the test of whether the body fits at a state.

    Two circles cover the body, as in the MPC. Around the car, the risk map decides, whose cells are
    finer; farther away, the cost map.
    """
    open_ = cost.clearance >= cost.required
    inverse = 1.0 / cost.frame.resolution
    ox, oy = cost.frame.origin
    rows, cols = cost.frame.shape
    x0, y0 = float(pose[0]), float(pose[1])
    offsets, radius = body.circles(2)
    ends = float(offsets[-1])
    close = near.obstacle_distance >= radius + BODY_MARGIN
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
        # A car that starts too close to an obstacle must be able to leave.
        if (x - x0) ** 2 + (y - y0) ** 2 < 0.2:
            return True
        cos, sin = ends * math.cos(yaw), ends * math.sin(yaw)
        return fits(x + cos, y + sin) and fits(x - cos, y - sin)

    return is_valid


def _path_cost(
    info: ob.SpaceInformation, space: ob.DubinsStateSpace, scratch: ob.State, cost: CostMap
) -> ob.OptimizationObjective:
    """Return the objective: the integral of the cost density along a curve."""
    from ompl import base as ob

    density, inverse = cost.density, 1.0 / cost.frame.resolution
    ox, oy = cost.frame.origin
    rows, cols = cost.frame.shape

    class PathCost(ob.OptimizationObjective):
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

    return PathCost(info)


def _goal_poses(along: NDArray[np.float64], target: int) -> Iterator[tuple[float, float, float]]:
    """Yield the poses (x, y, yaw) in which a curve may end at a point of the route."""
    back = along[max(0, target - 5)]
    heading = math.atan2(*(along[target] - back)[::-1])
    # At the goal any heading will do; before it, one close to the route's.
    turns = np.arange(8) * math.pi / 4 if target == len(along) - 1 else (0.0, 0.35, -0.35)
    for turn in turns:
        yield along[target, 0], along[target, 1], math.remainder(heading + turn, 2 * math.pi)


def _filled(scratch: ob.State, x: float, y: float, yaw: float) -> ob.State:
    """Write a pose into a state and return it, for OMPL to copy."""
    scratch.setX(float(x))
    scratch.setY(float(y))
    # OMPL's interval is open where ours is closed: +π is outside it.
    scratch.setYaw(float(yaw) if yaw < math.pi else -math.pi)
    return scratch


def _solve(info: ob.SpaceInformation, problem: ob.ProblemDefinition, config: PathConfig) -> None:
    """Let BIT* search until it finds a path, and then improve it."""
    from ompl import geometric as og

    search = og.BITstar(info)
    search.setProblemDefinition(problem)
    search.setSamplesPerBatch(config.batch)
    # With pruning OMPL 2.0.1 sometimes reads freed memory on a Dubins space, and crashes.
    search.setPruning(False)
    search.setup()
    search.setStopOnSolnImprovement(True)
    search.solve(_stop_after(config.iterations))
    if problem.hasExactSolution():
        search.setStopOnSolnImprovement(False)
        search.solve(_stop_after(config.refinements))


def _stop_after(count: int) -> ob.PlannerTerminationCondition:
    """Return a condition that stops a search after it has been asked `count` times."""
    from ompl import base as ob

    asked = itertools.count(1)
    return ob.PlannerTerminationCondition(lambda: next(asked) > count)
