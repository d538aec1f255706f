"""The closed loop: scan, decide, move, until the drive ends; and all that is worth recording."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from predictor.mapping.conventions import GOAL_RADIUS, TICK
from predictor.mapping.grid import OccupancyGrid
from predictor.mapping.scan import Scan
from sim.car import DubinsCar
from sim.lidar import Lidar
from sim.task import Task


class Outcome(StrEnum):
    """How a drive ended."""

    REACHED = "reached"
    COLLIDED = "collided"
    TIMED_OUT = "timed_out"
    STUCK = "stuck"


class Driver(Protocol):
    """What drives: `planner.navigator.Navigator`, or anything with its `step` and these two."""

    known: OccupancyGrid
    guide: Any

    def step(self, state: NDArray[np.float64], scan: Scan) -> Any:
        """Decide on a control; see `planner.navigator.Decision` for what is recorded."""
        ...


@dataclass(frozen=True)
class EpisodeConfig:
    """When a drive ends.

    Attributes:
        dt: of a tick [s].
        goal_radius: how near the goal counts as reached [m].
        timeout: times path length / v_max.
        stuck_distance: less than this [m] …
        stuck_time: … in this [s] is stuck.
    """

    dt: float = TICK
    goal_radius: float = GOAL_RADIUS
    timeout: float = 8.0
    stuck_distance: float = 0.2
    stuck_time: float = 10.0


@dataclass(frozen=True, eq=False)
class Episode:
    """A drive that has ended.

    Attributes:
        outcome: how.
        time: [s].
        path_length: driven [m].
        mean_speed: path_length / time [m/s].
        max_speed: in either gear [m/s].
        min_clearance: least distance between the body and something solid [m].
        stops: times that the car came to rest after it had set off, in either gear.
        impact_speed: at a collision [m/s], else None.
        faults: kind → ticks in which it was survived.
        paths: who planned the paths that were followed → how many.
        trace: what happened, tick by tick; see `run_episode`.
    """

    outcome: Outcome
    time: float
    path_length: float
    mean_speed: float
    max_speed: float
    min_clearance: float
    stops: int
    impact_speed: float | None
    faults: dict[str, int]
    paths: dict[str, int]
    trace: dict[str, NDArray]


def run_episode(
    task: Task,
    driver: Driver,
    car: DubinsCar,
    lidar: Lidar,
    config: EpisodeConfig,
    rng: np.random.Generator,
    on_tick: Callable[[int], None] | None = None,
) -> Episode:
    """Drive until the goal, a collision, the time limit, or until nothing moves.

    The trace, T ticks long:
        `states` (T+1, 4), the speed negative in reverse; `controls` (T, 2); `limits` (T,) index
        into `limit_names`; `plans` (T, N, 2) float16, the controls of each plan, and `gears` (T,)
        int8, the gear it is driven in, 1 or -1; `emergency`, `unsolved` (T,) bool;
        `relied_count` (T,), `relied_cells` (Σ, 2) int16 row and column in the world's frame and
        `relied_trust` (Σ,) uint8 in 1/255: which cells not seen each plan swept, and their
        confidence · p_free; `kept` (T,) int8: 1 if nothing solid was among them, 0 if the
        promise was broken, -1 if nothing was promised; `times` (T, stages) [ms] by
        `time_names`; `first_seen` (rows, columns) int16: in which tick, from 1, a cell of the
        world was first seen; `moment_*`: one tick in full, that with the most cells relied on.

    Args:
        task: where, from where, to where.
        driver: decides.
        car: moves.
        lidar: sees.
        config: when it ends.
        rng: noise of the LIDAR.
        on_tick: called with the number of each tick.
    """
    world = task.world
    state = np.array([*task.start, 0.0])
    limit_time = config.timeout * task.path_length / car.limits.v_max
    ticks_for_stuck = round(config.stuck_time / config.dt)
    log = _Log(world.grid.frame.shape)
    states = [state]
    outcome = Outcome.TIMED_OUT
    impact: float | None = None
    for tick in range(math.ceil(limit_time / config.dt)):
        if on_tick is not None:
            on_tick(tick)
        started = time.perf_counter()
        scan = lidar.scan(world, state, rng)
        scan_ms = 1e3 * (time.perf_counter() - started)
        decision = driver.step(state, scan)
        log.record(tick, decision, driver.known, task, scan_ms)
        collided = car.collides(world, state, decision.control, config.dt)
        before = abs(float(state[3]))
        state = car.step(state, decision.control, config.dt)
        states.append(state)
        if collided:
            outcome, impact = Outcome.COLLIDED, before
            break
        if math.hypot(state[0] - task.goal[0], state[1] - task.goal[1]) <= config.goal_radius:
            outcome = Outcome.REACHED
            break
        if len(states) > ticks_for_stuck:
            recent = np.array(states[-ticks_for_stuck - 1 :])[:, :2]
            if np.hypot(*np.diff(recent, axis=0).T).sum() < config.stuck_distance:
                outcome = Outcome.STUCK
                break
    drive = np.array(states)
    length = float(np.hypot(*np.diff(drive[:, :2], axis=0).T).sum())
    duration = (len(drive) - 1) * config.dt
    speed = np.abs(drive[:, 3])
    return Episode(
        outcome=outcome,
        time=duration,
        path_length=length,
        mean_speed=length / duration,
        max_speed=float(speed.max()),
        min_clearance=_clearance(task, drive, car),
        stops=int(((speed[1:] < 0.02) & (speed[:-1] >= 0.02)).sum()),
        impact_speed=impact,
        faults=dict(log.faults),
        paths=dict(driver.guide.counts),
        trace={"states": drive} | log.arrays(),
    )


def _clearance(task: Task, drive: NDArray[np.float64], car: DubinsCar) -> float:
    """Least distance from the body's outline to a solid cell [m], 0 where they overlap."""
    body, frame = car.limits.body, task.world.grid.frame
    along = np.linspace(-body.half_length, body.half_length, 11)
    across = np.linspace(-body.half_width, body.half_width, 7)
    outline = np.array(
        [(a, s * body.half_width) for a in along for s in (-1, 1)]
        + [(s * body.half_length, b) for b in across for s in (-1, 1)]
    )
    cos, sin = np.cos(drive[:, 2])[:, None], np.sin(drive[:, 2])[:, None]
    x = drive[:, :1] + cos * outline[:, 0] - sin * outline[:, 1]
    y = drive[:, 1:2] + sin * outline[:, 0] + cos * outline[:, 1]
    rows = np.floor((y - frame.origin[1]) / frame.resolution).astype(int)
    cols = np.floor((x - frame.origin[0]) / frame.resolution).astype(int)
    inside = (rows >= 0) & (rows < frame.shape[0]) & (cols >= 0) & (cols < frame.shape[1])
    if not inside.all():
        return 0.0
    return max(0.0, float(task.world.clearance[rows, cols].min()))


class _Log:
    """Collects the trace."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self.faults: Counter[str] = Counter()
        self._first_seen = np.zeros(shape, dtype=np.int16)
        self._rows: dict[str, list[Any]] = {
            name: []
            for name in ("controls", "gears", "plans", "limits", "emergency", "unsolved",
                         "relied_count", "relied_cells", "relied_trust", "kept", "times")
        }  # fmt: skip
        self._time_names: list[str] = []
        self._moment: tuple[int, int, Any] | None = None

    def record(
        self, tick: int, decision: Any, known: OccupancyGrid, task: Task, scan_ms: float
    ) -> None:
        rows = self._rows
        frame, solid = task.world.grid.frame, task.world.solid
        rows["controls"].append(decision.control[:2])
        rows["gears"].append(decision.plan.gear)
        rows["plans"].append(decision.plan.controls.astype(np.float16))
        rows["limits"].append(str(decision.limit))
        rows["emergency"].append(decision.emergency)
        rows["unsolved"].append("no_safe_solution" in decision.faults)
        self.faults.update(decision.faults)
        cells = np.floor((decision.relied - np.array(frame.origin)) / frame.resolution)
        cells = cells[:, ::-1].astype(np.int16)
        inside = ((cells >= 0) & (cells < np.array(frame.shape))).all(axis=1)
        broken = bool((~inside).any()) or bool(solid[tuple(cells[inside].T)].any())
        rows["relied_count"].append(len(cells))
        rows["relied_cells"].append(cells)
        rows["relied_trust"].append(np.rint(255 * decision.relied_trust).astype(np.uint8))
        rows["kept"].append(-1 if len(cells) == 0 else int(not broken))
        times = {"scan": scan_ms} | decision.times
        self._time_names = list(times)
        rows["times"].append(list(times.values()))
        self._see(tick, decision.plan.states[0], known, frame)
        # A moment worth a picture: the most relied upon; the middle of the drive's start if none.
        if self._moment is None or len(cells) > self._moment[0] or tick == 40 > self._moment[0]:
            self._moment = (len(cells), tick, decision)

    def _see(self, tick: int, state: NDArray[np.float64], known: OccupancyGrid, frame: Any) -> None:
        window = known.frame.square(state[0], state[1], known.window)
        row, col = known.frame.offset(window)
        top, left = frame.offset(window)
        # The part of the window that both the known grid and the world hold.
        a = max(0, -row, -top)
        b = max(0, -col, -left)
        c = min(window.shape[0], known.frame.shape[0] - row, frame.shape[0] - top)
        d = min(window.shape[1], known.frame.shape[1] - col, frame.shape[1] - left)
        if a < c and b < d:
            part = self._first_seen[top + a : top + c, left + b : left + d]
            seen = known.log_odds[row + a : row + c, col + b : col + d] != 0
            part[seen & (part == 0)] = tick + 1

    def arrays(self) -> dict[str, NDArray]:
        rows = self._rows
        names = sorted(set(rows["limits"]))
        out: dict[str, NDArray] = {
            "controls": np.array(rows["controls"], dtype=np.float32),
            "gears": np.array(rows["gears"], dtype=np.int8),
            "plans": _padded(rows["plans"]),
            "limits": np.array([names.index(name) for name in rows["limits"]], dtype=np.uint8),
            "limit_names": np.array(names),
            "emergency": np.array(rows["emergency"], dtype=bool),
            "unsolved": np.array(rows["unsolved"], dtype=bool),
            "relied_count": np.array(rows["relied_count"], dtype=np.int32),
            "relied_cells": np.concatenate(rows["relied_cells"]),
            "relied_trust": np.concatenate(rows["relied_trust"]),
            "kept": np.array(rows["kept"], dtype=np.int8),
            "times": np.array(rows["times"], dtype=np.float32),
            "time_names": np.array(self._time_names),
            "first_seen": self._first_seen,
        }
        if self._moment is not None:
            _, tick, decision = self._moment
            out |= _moment(tick, decision)
        return out


def _padded(plans: list[NDArray]) -> NDArray:
    """Plans as one array: those in reverse have fewer steps, after which the car stays at rest."""
    longest = max(len(plan) for plan in plans)
    return np.array([np.pad(plan, ((0, longest - len(plan)), (0, 0))) for plan in plans])


def _moment(tick: int, decision: Any) -> dict[str, NDArray]:
    """One tick in full, for a picture."""
    risk, prediction = decision.risk_map, decision.prediction
    out = {
        "moment_tick": np.array(tick),
        "moment_frame": np.array([risk.frame.resolution, *risk.frame.origin]),
        "moment_known": risk.known.cells,
        "moment_safe": risk.safe,
        "moment_plan": decision.plan.states.astype(np.float32),
        "moment_path": np.empty((0, 2), np.float32),
    }
    if decision.path is not None:
        out["moment_path"] = decision.path.points.astype(np.float32)
    if prediction is not None:
        frame = prediction.frame
        out["moment_prediction_frame"] = np.array([frame.resolution, *frame.origin])
        for name in ("p_free", "p_occupied", "confidence"):
            values = np.rint(255 * getattr(prediction, name)).astype(np.uint8)
            out[f"moment_{name}"] = values
    return out
