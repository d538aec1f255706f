"""One drive of a comparison: an episode's number and an arm, to its result and trace."""

from __future__ import annotations

import ctypes
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.optimal.shortest_way import NoWayError, shortest_way, time_bound, way_length
from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.settings import ARMS, VEHICLES, Arm, Settings
from planner.navigator import Navigator, NavigatorConfig
from predictor.infra.command_line import UsageError
from predictor.infra.environment import commit
from predictor.infra.workers import WorkersError
from predictor.mapping.car_limits import CarLimits
from predictor.mapping.family_names import FAMILIES
from predictor.mapping.grid import Grid, OccupancyGrid
from predictor.prediction import Prediction, Predictor
from predictor.provenance import fingerprint_of, has_learned
from predictor.registry import load_predictor
from sim import DubinsCar, Lidar, LidarConfig
from sim.episode import EpisodeConfig, Outcome, run_episode
from sim.families import generate
from sim.map_server import load_world
from sim.task import NoTaskError, Task, sample_task
from sim.world import World, sealed

MEASURES = ("time", "path_length", "mean_speed", "max_speed", "min_clearance")
"""Figures of `sim.episode.Episode` that results take over."""


Driven = tuple[DriveResult, dict[str, NDArray[Any]]]
"""What goes into `results.json`, and what goes into `traces.npz`."""


class Oracle:
    """A predictor that is told the truth: free and occupied, inside the window it is asked for.

    Args:
        world: the truth.
    """

    def __init__(self, world: World) -> None:
        self.world = world

    def predict(self, known: Grid, pose: NDArray[np.float64]) -> Prediction:
        """Return the truth, with full confidence."""
        free, surface = self.world.truth(known.frame)
        confidence = np.ones(known.frame.shape, dtype=np.float32)
        return Prediction(
            known.frame, free.astype(np.float32), surface.astype(np.float32), confidence
        )


def sources(names: tuple[str, ...]) -> list[str]:
    """Return the families and map files that `--world` names, folders opened.

    Raises:
        UsageError: if one is neither a family, nor a map, nor a folder with maps.
    """
    found: list[str] = []
    for name in names:
        path = Path(name)
        if name in FAMILIES:
            found.append(name)
        elif path.is_dir():
            maps = sorted(str(p) for p in path.iterdir() if p.suffix in (".yaml", ".yml"))
            if not maps:
                raise UsageError(f"--world: no .yaml map in the folder {name}")
            found += maps
        elif path.suffix in (".yaml", ".yml"):
            if not path.is_file():
                raise UsageError(f"--world: no such file: {name}")
            found.append(name)
        else:
            raise UsageError(
                f"--world: {name!r} is no family ({', '.join(FAMILIES)}), no .yaml map, no folder"
            )
    return found


def check_maps(names: tuple[str, ...]) -> None:
    """Load each map file that `--world` names.

    Raises:
        UsageError: if a name cannot be used.
        MapError: if a map cannot be read.
    """
    for place in sources(names):
        if place not in FAMILIES:
            load_world(place)


@lru_cache(maxsize=2)
def task_of(settings: Settings, index: int) -> Task:
    """Return the task of an episode, the same for every arm and every vehicle.

    Raises:
        NoTaskError: if the world has no drive of the length wanted.
    """
    places = sources(settings.world)
    place, seed = places[index % len(places)], settings.seed + index // len(places)
    return task_in(place, seed, CarLimits(v_max=settings.v_max))


def task_in(place: str, seed: int, car: CarLimits) -> Task:
    """Return a task in one of `sources`.

    Raises:
        NoTaskError: if the world has no drive of the length wanted.
    """
    world = generate(place, seed) if place in FAMILIES else sealed(load_world(place))
    return task_in_world(world, seed, car)


def task_in_world(world: World, seed: int, car: CarLimits) -> Task:
    """Return a task in a building: one of at least 20 m, or of 10 m if there is none.

    Raises:
        NoTaskError: if there is neither.
    """
    try:
        return sample_task(world, seed, car)
    except NoTaskError:
        return sample_task(world, seed, car, min_length=10.0)


@lru_cache(maxsize=2)
def shortest_length(task: Task) -> float | None:
    """Return the length of the shortest way of a task on the whole map [m].

    Returns:
        None if there is none: `benchmarks.optimal.shortest_way` may miss a gap hardly wider than
        the car.
    """
    radius = CarLimits().body.half_width
    try:
        return way_length(shortest_way(task.world, task.start[:2], task.goal, radius))
    except NoWayError:
        return None


def facts_of(task: Task) -> dict[str, Any]:
    """Return what results tell of a task: its building, seed, start and goal."""
    start, goal = ([float(v) for v in place] for place in (task.start, task.goal))
    return {"world": task.world.name, "seed": task.seed, "start": start, "goal": goal}


def score(
    outcome: str, time: float, path_length: float, shortest: float | None, car: CarLimits
) -> dict[str, float | None]:
    """Compare a drive with the least time and the shortest way of its task.

    Args:
        outcome: "reached" counts alone.
        time: it took [s].
        path_length: driven [m].
        shortest: length of the shortest way [m].
        car: its limits.

    Returns:
        `shortest_length` [m]; `t_bound`, T_bound [s]; `sct`, T_bound / time, 0 if the goal was not
        reached; `detour`, what was driven over the shortest way. Each None where the way is not
        known.
    """
    if shortest is None:
        return dict.fromkeys(("shortest_length", "t_bound", "sct", "detour"))
    bound = time_bound(shortest, car, EpisodeConfig().goal_radius)
    return {
        "shortest_length": shortest,
        "t_bound": bound,
        "sct": bound / time if outcome == Outcome.REACHED else 0.0,
        "detour": path_length / shortest,
    }


def attempt(settings: Settings, weights: str | None, item: tuple[int, str]) -> Driven | str:
    """Return `drive`, or a line why the episode cannot be driven.

    Args:
        settings: of the run.
        weights: fingerprint that the predictor must have here too, where another machine drives.
        item: number of the episode, and the arm.

    Raises:
        WorkersError: if it has another.
    """
    mine = fingerprint_of(load_predictor(settings.predictor))
    if mine != weights:
        raise WorkersError(f"a worker has the predictor {mine}, this run is of {weights}")
    try:
        return drive(settings, *item)
    except NoTaskError as error:
        return str(error)


def car_of(settings: Settings) -> CarLimits:
    """Return the limits of the car that drives."""
    return CarLimits(
        v_max=settings.v_max, braking=settings.braking, reverse=VEHICLES[settings.vehicle]
    )


def navigator_config(settings: Settings, arm: Arm, resolution: float) -> NavigatorConfig:
    """Return the settings of an arm's navigator.

    Args:
        settings: of the run.
        arm: what may be relied upon.
        resolution: of the map [m].
    """
    level = settings.level if arm.takes_risk else 0.0
    return NavigatorConfig(
        window=settings.window,
        expansion=settings.expansion,
        # A plan may rely upon whatever its last resort may.
        reliance=max(settings.reliance, level) if arm.reliance is None else arm.reliance,
        level=level,
        adapt=not settings.fixed_level,
        steer=arm.steer,
        oracle=arm.predictor == "oracle",
        margin=3 * settings.noise + resolution if settings.noise > 0 else 0.0,
        car=car_of(settings),
    )


def navigator_for(
    settings: Settings, arm: Arm, task: Task, predictor: Predictor | None, deadline: float
) -> Navigator:
    """Return the navigator of an arm at the start of a task.

    Args:
        settings: of the run.
        arm: what may be relied upon.
        task: where from, where to.
        predictor: the arm's.
        deadline: for its answers [s].
    """
    truth, window = task.world.grid, settings.window
    config = replace(navigator_config(settings, arm, truth.frame.resolution), deadline=deadline)
    known = OccupancyGrid.from_grid(truth, window) if arm.whole_map else task.blank(window)
    waypoints = task.waypoints if settings.route == "fixed" else None
    start = np.array(task.start)
    return Navigator(config, predictor, start, task.goal, known, waypoints, task.seed)


def drive(settings: Settings, index: int, arm_name: str, task: Task | None = None) -> Driven:
    """Drive one episode with one arm.

    Args:
        settings: of the run.
        index: number of the episode.
        arm_name: who drives.
        task: by default that of the episode; another may be of any building.

    Raises:
        NoTaskError: if the world has no drive of the length wanted.
    """
    task = task or task_of(settings, index)
    arm = ARMS[arm_name]
    car = car_of(settings)
    choices = {"chosen": load_predictor(settings.predictor), "oracle": Oracle(task.world)}
    predictor = choices.get(arm.predictor)
    # Whatever the machine is busy with, a drive must come out the same.
    navigator = navigator_for(settings, arm, task, predictor, deadline=600.0)
    lidar = Lidar(LidarConfig(range_noise=settings.noise, dropout=settings.dropout))
    # Of the task's seed, so that an episode is the same whichever it is of a run.
    rng = np.random.default_rng([task.seed, 2])
    episode = run_episode(task, navigator, DubinsCar(car), lidar, EpisodeConfig(), rng)
    _give_back()
    trace = episode.trace
    times = trace["times"][:, list(trace["time_names"]).index("cycle")]
    promised = trace["kept"] >= 0
    measured: dict[str, Any] = {name: float(getattr(episode, name)) for name in MEASURES}
    measured |= score(
        episode.outcome, episode.time, episode.path_length, shortest_length(task), car
    )
    result = DriveResult(
        arm=arm_name,
        vehicle=settings.vehicle,
        index=index,
        **facts_of(task),
        learned=has_learned(predictor, task.world.grid.cells),
        shortest=float(task.path_length),
        outcome=str(episode.outcome),
        **measured,
        stops=int(episode.stops),
        impact_speed=episode.impact_speed,
        promises=int(promised.sum()),
        promises_broken=int((trace["kept"] == 0).sum()),
        ticks=len(trace["kept"]),
        faults={str(k): int(v) for k, v in episode.faults.items()},
        paths={str(k): int(v) for k, v in episode.paths.items()},
        # Of the code that drove, which may be another machine's.
        commit=commit(),
        cycle_ms=[float(np.percentile(times, q)) for q in (50, 99)],
    )
    frame = task.world.grid.frame
    arrays = {f"e{index}/{arm_name}/{name}": values for name, values in trace.items()}
    arrays[f"w{index}/cells"] = task.world.grid.cells
    arrays[f"w{index}/frame"] = np.array([frame.resolution, *frame.origin])
    arrays[f"w{index}/waypoints"] = task.waypoints
    return result, arrays


def _give_back() -> None:
    """Give freed memory back to the system.

    glibc keeps it in pieces, and over drives in buildings of all sizes the pieces become too small
    for the next one's maps: a process grew by 0.5 MiB a drive.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
