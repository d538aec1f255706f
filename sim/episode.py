"""The closed loop: scan, decide, move, until the drive ends."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.body import Body
from foresee.mapping.conventions import GOAL_RADIUS, REST, TICK
from sim.car import DubinsCar
from sim.driver_protocol import Decision, Driver
from sim.errors import Errors, Robot
from sim.lidar import Lidar
from sim.recorder import Recorder
from sim.task import Task
from sim.world import World

D = TypeVar("D", bound=Decision)
"""Type of the driver's decisions."""
STANDSTILL = 0.02
"""Speed below which the car counts as standing when its stops are counted [m/s]."""
HARD_BRAKING, HARD_TICKS = 0.9, 3
"""Share of the car's hardest braking above which it brakes hard, and number of ticks for which it
does so before the one in which it comes to rest, if the stop is hard."""


class Outcome(StrEnum):
    """How a drive ended."""

    REACHED = "reached"
    COLLIDED = "collided"
    TIMED_OUT = "timed_out"
    STUCK = "stuck"


@dataclass(frozen=True)
class EpisodeConfig:
    """Settings of the closed loop: its tick, and when a drive ends.

    Attributes:
        dt: length of a tick [s].
        goal_radius: distance to the goal within which it is reached [m].
        timeout: time limit, as a multiple of the time for the task's path at top speed.
        stuck_distance: distance driven in `stuck_time` below which the car is stuck [m].
        stuck_time: period over which `stuck_distance` is measured [s].
        time_limit: time limit in place of that of `timeout` [s]; None: that of `timeout`.
    """

    dt: float = TICK
    goal_radius: float = GOAL_RADIUS
    timeout: float = 8.0
    stuck_distance: float = 0.2
    stuck_time: float = 10.0
    time_limit: float | None = None

    def ticks(self, task: Task, v_max: float) -> int:
        """Return the number of ticks after which a drive times out.

        Args:
            task: task of the drive.
            v_max: top speed of the car [m/s].
        """
        limit = self.time_limit
        if limit is None:
            limit = self.timeout * task.path_length / v_max
        return math.ceil(limit / self.dt)


@dataclass(frozen=True, eq=False)
class Episode:
    """A drive that has ended.

    Attributes:
        outcome: how the drive ended.
        time: duration [s].
        path_length: distance driven [m].
        mean_speed: path_length / time [m/s].
        max_speed: highest speed in either gear [m/s].
        min_clearance: least distance between the body's outline and a solid cell at the end of a
            tick, from the centre of one cell to that of the other: it exceeds the gap between them
            by at most 1.4 cells [m].
        stops: number of times that the car came to rest after it had set off, in either gear.
        hard_stops: number of these to which it braked hard, and after which it did not change gear.
        impact_speed: speed at the start of the tick with the collision [m/s]; None without one.
        faults: number of ticks in which a fault was handled, by the kind of fault.
        paths: number of paths followed, by source, of reversals, and of recovery
            manoeuvres.
        trace: arrays of what happened in each tick, by name; `sim.recorder.SHAPES` describes them.
    """

    outcome: Outcome
    time: float
    path_length: float
    mean_speed: float
    max_speed: float
    min_clearance: float
    stops: int
    hard_stops: int
    impact_speed: float | None
    faults: dict[str, int]
    paths: dict[str, int]
    trace: dict[str, NDArray[Any]]


def run_episode(
    task: Task,
    driver: Driver[D],
    car: DubinsCar,
    lidar: Lidar,
    config: EpisodeConfig,
    rng: np.random.Generator,
    observer: Callable[[int, D], None] | None = None,
    robot: Robot | None = None,
) -> Episode:
    """Drive until the goal, a collision, the time limit, or until the car no longer moves.

    Args:
        task: world, start and goal of the drive.
        driver: driver, which decides on each control.
        car: simulated car.
        lidar: simulated LIDAR.
        config: settings of the closed loop.
        rng: source of the LIDAR's noise.
        observer: function that is called in each tick with its number, from 0, and the decision.
        robot: errors of sensing and motion; None: there are none.
    """
    world, dt = task.world, config.dt
    robot = robot or Robot(Errors(), rng)
    states = [np.array([*task.start, 0.0])]
    recorder = Recorder(world)
    outcome: Outcome | None = None
    for _ in range(config.ticks(task, car.limits.v_max)):
        started = time.perf_counter()
        scan = lidar.scan(world, states[-1], rng)
        scan_ms = 1e3 * (time.perf_counter() - started)
        estimate = robot.estimate(states[-1])
        decision = driver.skip() if robot.misses() else driver.step(estimate, scan)
        recorder.record(decision, estimate, driver.known, scan_ms)
        if observer is not None:
            observer(len(states) - 1, decision)
        state, collided = states[-1], False
        moving = abs(state[3]) >= REST
        for control, span in robot.actuators.during(decision.control, dt, moving):
            collided = collided or car.collides(world, state, control, span)
            state = car.step(state, control, span)
        states.append(state)
        outcome = outcome_of(states, collided, task.goal, config)
        if outcome is not None:
            break
    drive = np.array(states)
    length, duration = _length(drive), (len(drive) - 1) * config.dt
    speed = np.abs(drive[:, 3])
    return Episode(
        outcome=outcome or Outcome.TIMED_OUT,
        time=duration,
        path_length=length,
        mean_speed=length / duration,
        max_speed=float(speed.max()),
        min_clearance=_clearance(task.world, drive, car.limits.body),
        stops=int(((speed[1:] < STANDSTILL) & (speed[:-1] >= STANDSTILL)).sum()),
        hard_stops=_hard_stops(drive[:, 3], HARD_BRAKING * car.limits.braking * dt),
        impact_speed=abs(float(drive[-2, 3])) if outcome == Outcome.COLLIDED else None,
        faults=dict(recorder.faults),
        paths=dict(driver.path_counts),
        trace={"states": drive} | recorder.arrays(),
    )


def outcome_of(
    states: list[NDArray[np.float64]],
    collided: bool,
    goal: tuple[float, float],
    config: EpisodeConfig,
) -> Outcome | None:
    """Return how a drive has ended; None: it goes on, if there is time left.

    Args:
        states: x, y, yaw, v of the car, (4,) each, at the start and after each tick.
        collided: whether the car collided in the last tick.
        goal: x, y of the goal [m].
        config: settings of the closed loop.
    """
    if collided:
        return Outcome.COLLIDED
    if math.hypot(*(states[-1][:2] - goal)) <= config.goal_radius:
        return Outcome.REACHED
    return Outcome.STUCK if _is_stuck(states, config) else None


def _is_stuck(states: list[NDArray[np.float64]], config: EpisodeConfig) -> bool:
    """Return whether the car has hardly moved in the last `config.stuck_time` seconds."""
    ticks = round(config.stuck_time / config.dt)
    recent = np.array(states[-ticks - 1 :])
    return len(recent) > ticks and _length(recent) < config.stuck_distance


def _length(states: NDArray[np.float64]) -> float:
    """Return the length [m] of the polyline through the positions of some states (n, 4)."""
    return float(np.hypot(*np.diff(states[:, :2], axis=0).T).sum())


def _hard_stops(speeds: NDArray[np.float64], loss: float) -> int:
    """Count the hard stops of a drive.

    Args:
        speeds: speed at the start and at the end of each tick, negative in reverse, (n,) [m/s].
        loss: loss of speed in a tick above which the car brakes hard [m/s].
    """
    hard = np.abs(speeds[:-1]) - np.abs(speeds[1:]) > loss
    moves = np.abs(speeds) >= STANDSTILL
    count = 0
    for rest in np.flatnonzero(moves[:-1] & ~moves[1:]):
        later = speeds[rest + 1 :][moves[rest + 1 :]]
        changes_gear = len(later) > 0 and later[0] * speeds[rest] < 0
        # The tick in which the car comes to rest brakes only as hard as is left to do.
        braked = rest >= HARD_TICKS and hard[rest - HARD_TICKS : rest].all()
        count += bool(braked and not changes_gear)
    return count


def _clearance(world: World, drive: NDArray[np.float64], body: Body) -> float:
    """Return `Episode.min_clearance` of a drive [m]; 0 if the body overlaps a solid cell."""
    along = np.linspace(-body.half_length, body.half_length, 11)
    across = np.linspace(-body.half_width, body.half_width, 7)
    outline = np.array(
        [(a, s * body.half_width) for a in along for s in (-1, 1)]
        + [(s * body.half_length, b) for b in across for s in (-1, 1)]
    )
    cos, sin = np.cos(drive[:, 2])[:, None], np.sin(drive[:, 2])[:, None]
    x = drive[:, :1] + cos * outline[:, 0] - sin * outline[:, 1]
    y = drive[:, 1:2] + sin * outline[:, 0] + cos * outline[:, 1]
    inside, rows, cols = world.grid.frame.locate(np.column_stack([x.ravel(), y.ravel()]))
    if not inside.all():
        return 0.0
    return max(0.0, float(world.clearance[rows, cols].min()))
