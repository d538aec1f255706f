"""Training samples of `predictor.drives` and `predictor.train`, recorded on simulated walks.

A point walks along the planner's routes, without prediction, through generated buildings and the
user's own ones. Each walk is replayed with LIDARs of other windows and other noise. Logs of robots,
simulated or the user's, are replayed as well.
"""

from __future__ import annotations

import contextlib
import json
import math
import sys
from collections.abc import Iterator
from dataclasses import asdict
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from foresee.infra.atomic_file import write_whole
from foresee.infra.command_line import UsageError
from foresee.infra.plain_json import read_object
from foresee.infra.resumable import ResumableFolder
from foresee.mapping.context import SIDE as CONTEXT_SIDE
from foresee.mapping.grid import Grid, OccupancyGrid, world_hash
from foresee.mapping.polyline import arc_length
from predictor.data.bag_config import BagConfig
from predictor.data.frames import MANIFEST
from predictor.data.laser_log import LaserLog
from predictor.data.log_files import is_log, read_log
from predictor.data.samples import FORMAT, PLANNED, RECIPE, SIDE, encoded, write_samples
from predictor.data.squares import decode_cells, encode_cells, truth_codes
from predictor.data.survey import REACH, clipped, frame_around, surveyed
from predictor.recording.own_buildings import OwnBuildings, log_hash, read_building
from predictor.recording.rescan import rescanned
from predictor.recording.sample_set import DRIVES, Item, make_missing, sample_path
from predictor.recording.settings import DrivesConfig
from predictor.recording.simulated_log import ROBOT, SimulatedLogConfig, simulated_log
from predictor.recording.walk import walked
from sim import LidarConfig
from sim.buildings import task_in_world
from sim.families import generate
from sim.task import NoTaskError, sample_task
from sim.variation import varied
from sim.world import World

WINDOWS = (5.0, 5.0, 5.0, 5.0, 7.0, 10.0, 20.0, 40.0)
"""Sides of the square in which the LIDAR is used, drawn at random [m]."""
JOURNEYS, APART = (1, 2, 4, 8), 2.0
"""Numbers of routes through the building in a simulated log, drawn at random, since some robots
visit each room and some only one corridor; distance from one sample of a log to the next [m]."""
STRETCH = 50.0
"""Length of a user's log that one replay covers [m], so that it gives no more samples than a
drive."""
Posed = tuple[bytes, "NDArray[np.float64]"]
"""A sample, and the pose of the robot in it, (3,) [m, m, rad]."""
SPREAD = 10_000_000
"""Difference of seeds from one route of a log to the next, larger than any split."""


def record(config: DrivesConfig, own: OwnBuildings, item: Item) -> tuple[int, str]:
    """Make and write the samples of one drive.

    Args:
        config: settings of the set.
        own: the user's own buildings, `config.world`.
        item: split, and number of the drive in it.

    Returns:
        The number of samples; and why there is none, or an empty string.
    """
    split, number = item
    seed = DRIVES[split] + number
    rng = np.random.default_rng(seed)
    kind, path = draw_place(config, own, split, number)
    if path is not None and is_log(path):
        log, truth, drawn = _surveyed(path, config.topics)
        driven_through, made = drawn, _replayed(config, log, truth, rng, STRETCH)
    else:
        world = generate(kind, seed) if path is None else read_building(path)
        drawn = world_hash(world.grid.cells)
        # Half of the generated buildings are varied, since the network's probabilities are
        # calibrated only for kinds of buildings that it was trained on.
        if path is None and rng.random() < 0.5:
            world = varied(world, rng)
        driven_through = world_hash(world.grid.cells)
        logged = path is None and rng.random() < config.simulated_logs
        made = (_logged if logged else _walked)(config, world, seed, rng)
    samples, reason = [], ""
    try:
        samples = list(made)
    except NoTaskError as error:
        reason = str(error)
    about = {"family": kind, "seed": seed, "world": driven_through, "original": drawn}
    write_samples(sample_path(config.out, item), samples, about)
    return len(samples), reason


def draw_place(
    config: DrivesConfig, own: OwnBuildings, split: str, number: int
) -> tuple[str, Path | None]:
    """Choose the building of a drive.

    Drives in the user's own buildings are spread evenly among the others. If none of these
    buildings is held out, all drives for validation are in generated buildings.

    Args:
        config: settings of the set.
        own: the user's own buildings.
        split: "train" or "validation".
        number: number of the drive in its split.

    Returns:
        The family of a generated building, "map" or "log"; and the path of the map or log, or None.
    """
    buildings = own.of(split)
    share = config.share if buildings else 0.0
    before, after = math.floor(number * share), math.floor((number + 1) * share)
    if after == before:
        return config.families[(number - before) % len(config.families)], None
    paths = buildings[before % len(buildings)].paths
    path = Path(paths[before // len(buildings) % len(paths)])
    return "log" if is_log(path) else "map", path


def _walked(
    config: DrivesConfig, world: World, seed: int, rng: np.random.Generator
) -> Iterator[Posed]:
    """Yield the samples of a walk, with the map of the building as truth.

    Raises:
        NoTaskError: if the building has no route for the car.
    """
    task = task_in_world(world, seed)
    poses = walked(task, config.longest, float(rng.choice(WINDOWS)))
    for _ in range(config.views):
        window = float(rng.choice(WINDOWS))
        noise = float(rng.choice([0.0, 0.0, 0.01, 0.03]))
        lidar = LidarConfig(range_noise=noise, dropout=float(rng.choice([0.0, 0.05])))
        first = int(rng.integers(config.every))
        for known, pose in rescanned(task, poses, window, lidar, rng, config.every, first):
            side = SIDE * known.frame.resolution
            crop = known.crop(known.frame.square(pose[0], pose[1], side))
            truth = truth_codes(*task.world.truth(crop.frame))
            around = known.crop(known.frame.square(pose[0], pose[1], CONTEXT_SIDE))
            yield encoded(crop, truth, around, pose[2]), pose


def _logged(
    config: DrivesConfig, world: World, seed: int, rng: np.random.Generator
) -> Iterator[Posed]:
    """Yield the samples of a simulated log, with the map of the whole log as truth.

    Raises:
        NoTaskError: if the building has no route for the robot.
    """
    # All routes but the first may be missing, since from some starts there is none of that length.
    tasks = [sample_task(world, seed, ROBOT)]
    for number in range(1, int(rng.choice(JOURNEYS))):
        with contextlib.suppress(NoTaskError):
            tasks.append(sample_task(world, SPREAD * number + seed, ROBOT))
    log = simulated_log(tasks, rng)
    yield from _replayed(config, log, _survey_log(log), rng)


@lru_cache(maxsize=2)
def _surveyed(path: Path, topics: BagConfig | None) -> tuple[LaserLog, Grid, str]:
    """Return a log, its map, and its hash."""
    log = read_log(path, topics)
    return log, _survey_log(log), log_hash(log)


def _survey_log(log: LaserLog) -> Grid:
    """Return the map of all scans of a log."""
    frame = frame_around(log.poses, REACH)
    scans = [clipped(scan, REACH) for scan in log.scans]
    return Grid(frame, decode_cells(surveyed(frame, scans, log.poses)))


def _replayed(
    config: DrivesConfig,
    log: LaserLog,
    truth: Grid,
    rng: np.random.Generator,
    longest: float = math.inf,
) -> Iterator[Posed]:
    """Yield the samples of a log, which is replayed `config.views` times.

    Args:
        config: settings of the set.
        log: scans and poses.
        truth: map of the whole log.
        rng: generator of the windows and of the beginnings of the replays.
        longest: distance that a replay covers [m]; if it is finite, each begins at a random scan.
    """

    frame = truth.frame
    side = SIDE * frame.resolution
    along = arc_length(log.poses)
    starts = max(1, int((along < along[-1] - longest).sum()))
    for _ in range(config.views):
        window = float(rng.choice(WINDOWS))
        begin = int(rng.integers(starts)) if longest < math.inf else 0
        x, y = (float(value) for value in log.poses[begin, :2])
        known = OccupancyGrid(frame.square(x, y, window), window)
        travelled = float(rng.uniform(0.0, APART))
        for number in range(begin, len(log)):
            if along[number] > along[begin] + longest:
                break
            pose = log.poses[number]
            known.integrate(clipped(log.scans[number], REACH), pose)
            travelled += along[number] - along[max(number - 1, begin)]
            if travelled >= APART:
                # The remainder is carried over, but not whole jumps from one route to the next.
                travelled %= APART
                square = frame.square(float(pose[0]), float(pose[1]), side)
                true = encode_cells(truth.crop(square).cells)
                around = known.crop(frame.square(float(pose[0]), float(pose[1]), CONTEXT_SIDE))
                yield encoded(known.crop(square), true, around, float(pose[2])), pose


def make(config: DrivesConfig, jobs: int, learned: frozenset[str] = frozenset()) -> None:
    """Make all missing samples of a set, with a progress bar.

    Args:
        config: settings of the set.
        jobs: number of worker processes.
        learned: hashes of buildings that may not be held out, since the weights to start from were
            trained in them.

    Raises:
        UsageError: if the folder holds samples that were made with other settings, or if
            `config.world` names no usable building, or a building in `learned` that would be held
            out, or if topics are given and `config.world` is empty.
    """
    if config.topics and not config.world and (without := config.topics.changed()):
        raise UsageError(f"{without[0]} needs --world")
    if not config.world and "--share" in config.changed():
        raise UsageError("--share needs --world")
    own = OwnBuildings.read(config.world, config.topics)
    for line in own.skipped:
        print(f"skipped: {line}", file=sys.stderr)
    if config.world:
        _check(config, own, learned)
    _claim(config, own)
    drives = {split: getattr(config, split) for split in DRIVES}
    # For trainings that are not told how many drives there are.
    write_whole(config.out / PLANNED, json.dumps(drives).encode())
    make_missing(config.out, drives, partial(record, config, own), jobs, "drive")


def _check(config: DrivesConfig, own: OwnBuildings, learned: frozenset[str]) -> None:
    """Check that the user's own buildings fit the settings, and warn of buildings without drives.

    Raises:
        UsageError: if they do not fit.
    """
    if config.share == 0:
        raise UsageError("--share is 0: no drive would be in the buildings of --world")
    if not own.validation and config.share == 1:
        raise UsageError(
            "--world: one building cannot be both trained on and held out: give two, or a "
            "--share below 1"
        )
    if not own.validation:
        line = "--world has one building, which is trained on: scores are of generated buildings"
        print(f"warning: {line}", file=sys.stderr)
    known = [building.paths[0] for building in own.validation if learned & set(building.hashes)]
    if known:
        raise UsageError(
            f"--start: its weights have learned from {', '.join(known)}, which would be held out: "
            "start from other weights, or leave it out"
        )
    for split in DRIVES:
        drives = math.floor(getattr(config, split) * config.share)
        missed = len(own.of(split)) - drives
        if missed > 0:
            print(
                f"warning: no {split} drive is in {missed} of the buildings of --world: give "
                f"more --{split}",
                file=sys.stderr,
            )


def _claim(config: DrivesConfig, own: OwnBuildings) -> None:
    """Refuse a folder with samples made with other settings.

    Raises:
        UsageError: if the folder holds frames, or samples made with other settings.
    """
    if (config.out / MANIFEST).exists():
        raise UsageError(f"{config.out} holds frames of predictor.dataset: choose another folder")
    recipe = {
        "format": FORMAT,
        "seeds": DRIVES,
        "views": config.views,
        "families": config.families,
        "own": own.hashes,
        "share": config.share if config.world else 0,
        "windows": WINDOWS,
        "longest": config.longest,
        "every": config.every,
        "logs": config.simulated_logs,
        "log": asdict(SimulatedLogConfig()),
        "journeys": JOURNEYS,
        "apart": APART,
    }
    recorded = own.hashes
    with contextlib.suppress(OSError, ValueError):
        recorded = read_object(config.out / RECIPE).get("own", recorded)
    if recorded != own.hashes:
        raise UsageError(
            f"{config.out} holds samples of other buildings of --world: choose another folder "
            "(--data, in predictor.drives --out), and another --out for the training"
        )
    ResumableFolder(config.out, recipe, marker=RECIPE)
