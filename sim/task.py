"""Tasks: a start, a goal far away, and a way between them that the car can drive."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from foresee.infra.errors import LineError
from foresee.mapping.body import Body, Scene, first_contact
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.conventions import GOAL_RADIUS
from foresee.mapping.grid import FREE, OCCUPIED, GridFrame, OccupancyGrid
from foresee.mapping.polyline import arc_length, points_at
from sim.arc_search import HEADINGS, search_arcs
from sim.car import wrap
from sim.lidar import cast_rays
from sim.world import World

START_CLEARANCE = 0.3
"""Free space around the body at the start and around the goal [m]."""
START_MARGINS = (0.5, 0.4, 0.3, 0.2, 0.1, 0.05, 0.02, 0.0)
"""Margins around the body at the start that a driver may be told are free [m], see `Task`. With
none of them, the cells beside the body count as unobserved, and the driver cannot even stand."""
WAY_CLEARANCE = 0.05
"""Free space around the body along the way [m]."""
COMFORT = 0.4
"""Additional free space around the body along the way, where there is room [m]."""
SPACING = 2.0
"""Approximate distance between waypoints [m]."""
SLACK = 1.1
"""Ratio of the way's turning radius to the car's."""
MARGIN = 10.0
"""Margin of a blank grid around start and goal [m]; the grid grows as needed."""
NO_TRIP = 5.0
"""Straight-line distance from the start below which a goal is drawn again [m]."""
STARTS = 25
"""Number of starts that are tried in a world."""
SHORTEST_LEG, LONGEST_LEG = 8.0, 40.0
"""Shortest and longest way from one goal to the next, in a drive with several goals [m]."""
NEW = 5.0
"""Distance of a goal from the way so far above which it counts as a new place [m]."""
APART, AGAIN = 3.0, 0.5
"""Distance along a way above which two of its points count as passed one after the other, and
distance between such points below which the way comes back to where it was [m]."""


@dataclass(frozen=True)
class Rules:
    """When a drive ends, how fast the car may be, and what its time is compared with.

    Attributes:
        goal_radius: distance from the goal within which it is reached [m].
        time_limit: time after which the drive ends [s]; None: that of `sim.episode.EpisodeConfig`.
        top_speed: highest speed allowed [m/s]; None: that of the car.
        score_speed: speed at which the shortest path takes T*, the time that the BARN score
            compares with [m/s]; None: the drive has no such score.
        published_length: length of the shortest path, as published with the task [m]; None: it is
            computed.
    """

    goal_radius: float = GOAL_RADIUS
    time_limit: float | None = None
    top_speed: float | None = None
    score_speed: float | None = None
    published_length: float | None = None


@dataclass(frozen=True, eq=False)
class Task:
    """A drive through a world.

    Attributes:
        world: the building.
        start: x, y, yaw at the start [m, m, rad].
        goal: x, y of the goal [m].
        waypoints: points about 2 m apart along a way on the true map, the goal the last, (n, 2)
            [m].
        path_length: length of this way [m].
        seed: seed with which the task was drawn, and from which the drive draws its noise.
        rules: when the drive ends, and how fast the car may be.
    """

    world: World
    start: tuple[float, float, float]
    goal: tuple[float, float]
    waypoints: NDArray[np.float64]
    path_length: float
    seed: int
    rules: Rules = Rules()

    @property
    def comes_back(self) -> bool:
        """Whether the way passes a place twice, after its first metres.

        A driver at that place cannot tell which part of the way it follows. The first metres do not
        count: there, a car that starts in the wrong direction turns round.
        """
        corners = np.vstack([self.start[:2], self.waypoints])
        at = np.arange(APART, arc_length(corners)[-1], 0.1)
        points = points_at(corners, at)
        pairs = cKDTree(points).query_pairs(AGAIN, output_type="ndarray")
        return bool((np.abs(at[pairs[:, 1]] - at[pairs[:, 0]]) > APART).any())

    def start_margin(self, body: Body) -> float:
        """Return the margin around a body at the start that is free, of `START_MARGINS` [m].

        A driver counts these cells as observed, since the LIDAR does not see all of them.
        """
        solid, frame = self.world.solid, self.world.grid.frame
        for margin in START_MARGINS:
            scene = Scene(solid, *frame.lattice, *body.inflated(margin).halves)
            if first_contact(scene, np.array([self.start])) < 0:
                return margin
        return 0.0

    def mark_start(self, known: OccupancyGrid, body: Body) -> None:
        """Mark the space around the start that a driver counts as observed, in its map.

        Args:
            known: map of the driver, which is changed.
            body: body of the car.
        """
        known.mark_free(self.start, body, self.start_margin(body))

    def blank(self, window: float) -> OccupancyGrid:
        """Return an occupancy grid around start and goal in which nothing is observed yet.

        Args:
            window: side of the square around the car in which a scan changes the grid [m].
        """
        frame = self.world.grid.frame
        ends = np.array([self.start[:2], self.goal])
        low, high = ends.min(axis=0) - MARGIN, ends.max(axis=0) + MARGIN
        first = np.floor((low - frame.origin) / frame.resolution)
        origin = frame.origin + frame.resolution * first
        cols, rows = np.ceil((high - origin) / frame.resolution).astype(int)
        at = (float(origin[0]), float(origin[1]))
        return OccupancyGrid(GridFrame(frame.resolution, at, (int(rows), int(cols))), window)


class NoTaskError(LineError):
    """No start and goal of the requested kind was found in a world."""


def sample_task(
    world: World,
    seed: int,
    car: CarLimits | None = None,
    min_length: float = 20.0,
    max_length: float = 80.0,
) -> Task:
    """Draw a start and a goal between which the car can drive, forwards all the way.

    The start has room around it and is directed along free space. The goal is drawn from the far
    part of the places that can be reached from there, at least `NO_TRIP` from the start in a
    straight line. The same seed gives the same task.

    Args:
        world: building in which to drive.
        seed: seed of the start and the goal.
        car: the car's body and turning radius; None: the defaults.
        min_length: minimum length of the way [m].
        max_length: maximum length of the way [m].

    Raises:
        NoTaskError: if no start that was tried has a way of such a length.
        ValueError: if the lengths contradict each other, or are negative or not finite.
    """
    if not 0 <= min_length <= max_length < math.inf:
        raise ValueError(
            f"lengths are {min_length} to {max_length} m, they must satisfy 0 <= "
            "min_length <= max_length"
        )
    car = car or CarLimits()
    rng = np.random.default_rng(seed)
    frame = world.grid.frame
    roomy = _roomy(world, car)
    candidates = np.argwhere(roomy)
    farthest = 0.0
    for _ in range(STARTS if len(candidates) else 0):
        row, col = candidates[rng.integers(len(candidates))]
        x, y = frame.centre(row, col)
        start = (x, y, _free_direction(world, x, y, rng))
        poses, parents, lengths, goals = _ways(world, start, car, roomy, max_length)
        reach = float(lengths[goals].max(initial=0.0))
        farthest = max(farthest, reach)
        goals &= (lengths >= max(min_length, 0.6 * reach)) & (lengths <= max_length)
        if goals.any():
            chosen = int(rng.choice(np.flatnonzero(goals)))
            away = np.hypot(*(poses[:, :2] - poses[0, :2]).T) >= NO_TRIP
            if not away[chosen]:
                # Draw again, among the goals that are far enough. The first draw is kept for the
                # sake of all other seeds, whose tasks stay the same.
                goals &= away
                if not goals.any():
                    continue
                chosen = int(rng.choice(np.flatnonzero(goals)))
            way = _trace(poses, parents, chosen)
            goal = (float(way[-1, 0]), float(way[-1, 1]))
            return Task(world, start, goal, waypoints_along(way), float(lengths[chosen]), seed)
    raise NoTaskError(
        f"{world.name}: no way of {min_length:g} to {max_length:g} m for this car was found; "
        f"the longest of {STARTS} starts led {farthest:.1f} m"
    )


def find_way(
    world: World,
    start: tuple[float, float, float],
    goal: tuple[float, float],
    goal_radius: float,
    car: CarLimits | None = None,
) -> NDArray[np.float64] | None:
    """Return points of a short way to a goal that the car can drive forwards, (n, 2) [m].

    The last point is the goal; the one before is within the goal's radius.

    Args:
        world: building in which to drive.
        start: x, y, yaw at the start [m, m, rad].
        goal: x, y of the goal [m].
        goal_radius: distance from the goal within which it is reached [m].
        car: the car's body and turning radius; None: the defaults.

    Returns:
        None if no such way was found.
    """
    car = car or CarLimits()
    poses, parents, lengths, _ = _ways(world, start, car, _roomy(world, car), math.inf)
    off = np.hypot(*(poses[:, :2] - goal).T)
    best = int(np.where(off <= goal_radius, lengths + off, math.inf).argmin())
    if off[best] > goal_radius:
        return None
    return np.vstack([_trace(poses, parents, best)[:, :2], goal])


def prolonged(task: Task, length: float, car: CarLimits | None = None) -> Task:
    """Return a task with more goals after its own, until its way is long enough.

    Each goal is drawn from the far part of the places that can be reached from the one before, if
    possible at a place that the way has not passed yet, so that a long drive sees much of a
    building. The same task gives the same result.

    Args:
        task: beginning of the drive.
        length: minimum length of the whole way [m].
        car: the car's body and turning radius; None: the defaults.

    Raises:
        NoTaskError: if the car cannot go on from one of the goals.
    """
    car = car or CarLimits()
    rng = np.random.default_rng([task.seed, 1])
    roomy = _roomy(task.world, car)
    points, driven = np.vstack([task.start[:2], task.waypoints]), task.path_length
    while driven < length:
        dx, dy = points[-1] - points[-2]
        start = (float(points[-1, 0]), float(points[-1, 1]), math.atan2(dy, dx))
        poses, parents, lengths, goals = _ways(task.world, start, car, roomy, LONGEST_LEG)
        goals &= lengths >= max(SHORTEST_LEG, 0.6 * float(lengths[goals].max(initial=0.0)))
        if not goals.any():
            raise NoTaskError(
                f"{task.world.name}: after {driven:.0f} of {length:.0f} m there is no going on"
            )
        far = np.flatnonzero(goals)
        gaps, _ = cKDTree(points).query(poses[far, :2])
        new = far[np.asarray(gaps) > NEW]
        chosen = int(rng.choice(new if len(new) else far))
        points = np.vstack([points, waypoints_along(_trace(poses, parents, chosen))])
        driven += float(lengths[chosen])
    goal = (float(points[-1, 0]), float(points[-1, 1]))
    return Task(task.world, task.start, goal, points[1:], driven, task.seed)


def reachable(
    world: World, pose: tuple[float, float, float], car: CarLimits, longest: float
) -> NDArray[np.float64]:
    """Return the poses that a car without a reverse gear can reach, (n, 3) [m, m, rad].

    Args:
        world: building in which to drive.
        pose: x, y, yaw at the start [m, m, rad].
        car: the car's body and turning radius.
        longest: maximum length of a way [m].
    """
    return _ways(world, pose, car, _roomy(world, car), longest)[0]


def _roomy(world: World, car: CarLimits) -> NDArray[np.bool_]:
    """Return the cells in which a drive may begin and end, (rows, columns)."""
    # Clearances are measured between the centres of cells, up to a diagonal more than the free
    # space.
    lost = math.sqrt(2.0) * world.grid.frame.resolution
    return np.asarray(world.clearance > car.body.radius + START_CLEARANCE + lost)


def _ways(
    world: World,
    start: tuple[float, float, float],
    car: CarLimits,
    roomy: NDArray[np.bool_],
    longest: float,
) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.float64], NDArray[np.bool_]]:
    """Find the poses that a car can reach from a start on ways of at most `longest` [m].

    Returns:
        Poses (n, 3), indices of their parents (n,), lengths of the ways to them (n,) [m], and
        whether they can be goals (n,), for which they must lie in `roomy` cells.
    """
    radius = SLACK * car.turning_radius
    poses, parents, arcs, first = search_arcs(
        world, start, car.body, radius, WAY_CLEARANCE, COMFORT, longest
    )
    _, rows, cols = world.grid.frame.locate(poses[:, :2])
    # Only the first pose at each place: others reach it by a detour.
    goals = first & roomy[rows, cols]
    lengths = arcs.astype(np.float64) * (radius * 2 * math.pi / HEADINGS)
    return poses, parents, lengths, goals


def _free_direction(world: World, x: float, y: float, rng: np.random.Generator) -> float:
    """Draw a heading [rad] from the quarter of all headings with the most free space ahead."""
    frame = world.grid.frame
    angles = rng.uniform(-math.pi, math.pi) + np.arange(32) * (2 * math.pi / 32)
    beams = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    # All solid cells return a beam, since the body must not enter UNKNOWN cells either.
    cells = np.where(world.solid, np.int8(OCCUPIED), np.int8(FREE))
    ranges = cast_rays(world.skips, cells, *frame.in_cells(x, y), 0.0, beams, math.inf)
    best = np.argsort(-np.nan_to_num(ranges), kind="stable")[:8]
    return wrap(float(angles[rng.choice(best)]))


def _trace(
    poses: NDArray[np.float64], parents: NDArray[np.int32], node: int
) -> NDArray[np.float64]:
    """Return the poses (n, 3) from the start to a node."""
    order = [node]
    while parents[order[-1]] >= 0:
        order.append(int(parents[order[-1]]))
    return poses[order[::-1]]


def waypoints_along(way: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return evenly spaced points (n, 2) [m] along a way, without its start and with its end.

    Args:
        way: x and y of its points in the first two columns, (m, 2 or more) [m].
    """
    length = arc_length(way)[-1]
    count = max(1, round(length / SPACING))
    points = points_at(way, length * np.arange(1, count + 1) / count)
    # The last waypoint is the goal exactly, without the rounding error of the interpolation.
    points[-1] = way[-1, :2]
    return points
