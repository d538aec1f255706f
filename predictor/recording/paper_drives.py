"""The paper's simulated data set, made of drives of the project's own planner, tick by tick.

Katyal et al. 2018 have two maps with paths 3.5–10 m wide, and six trajectories at 10 Hz and 0.5 m/s
with a LIDAR of 270° and 20 m. Four trajectories, 5,221 images, are for training, and two, 1,090
images, for testing; each map has two of the four and one of the two. Here there are also drives for
validation and more test drives, each on a map of its own.

Unlike in the paper, the buildings may be cluttered and the ranges noisy, and there may be walking
people, who are not in the true map, as in real logs.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from foresee.infra.errors import LineError
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.conventions import NOISE_CUT, TICK
from foresee.mapping.error_bounds import ErrorBounds
from foresee.mapping.grid import world_hash
from planner.guide.guide_config import GuideConfig
from planner.navigator import Navigator
from planner.navigator_config import NavigatorConfig
from predictor.data.frame_set import WINDOW, Recording, write_trajectory
from predictor.data.squares import truth_codes
from predictor.recording.settings import PER_SPLIT, SimulatedConfig
from sim import DubinsCar, Lidar, LidarConfig
from sim.families import generate
from sim.people import People
from sim.task import LONGEST_LEG, NoTaskError, prolonged, sample_task
from sim.variation import cluttered
from sim.world import World

FAMILY = "paper"
"""Family of the generated buildings."""
SPEED = 0.5
"""Speed of the car [m/s]."""
FIRST_MAP, FIRST_DRIVE = 700_000, 710_000
"""First seeds of buildings and of drives; training samples and published results use others."""
PATH_EVERY = 40
"""Number of ticks from one path search to the next: 2 m at this speed. A search takes as long as
ten ticks."""
TRIES = 20
"""Number of seeds that are tried for each drive."""
CIRCLES = 1.5, 40.0
"""Number of full turns, and time within which they count as driving in circles [s]."""


class DriveError(LineError):
    """A drive cannot be made; the message is one line."""


@dataclass(frozen=True)
class PaperDrive:
    """One trajectory of the set.

    Attributes:
        name: name of its file.
        split: split that it belongs to.
        map_seed: seed of its building.
        seed: seed of its task, the first that is tried.
        count: number of frames.
    """

    name: str
    split: str
    map_seed: int
    seed: int
    count: int


def set_settings(config: SimulatedConfig) -> dict[str, Any]:
    """Return all settings that decide the frames of a data set, for its manifest."""
    return asdict(config) | {
        "family": FAMILY,
        "speed": SPEED,
        "tick": TICK,
        "first_map": FIRST_MAP,
        "first_drive": FIRST_DRIVE,
    }


def plan_drives(config: SimulatedConfig) -> list[PaperDrive]:
    """Return all trajectories of a data set."""
    shares = {
        "train": _shared(config.train, 4),
        "test": _shared(config.test, 2),
        "more": [config.length] * config.more,
        "validation": [config.length] * config.validation,
    }
    drives = []
    for place, (split, counts) in enumerate(shares.items()):
        for number, count in enumerate(counts):
            # The six drives of the paper are on two maps; each of the others has a map of its own.
            paper = split in ("train", "test")
            map_seed = FIRST_MAP + (number % 2 if paper else place * PER_SPLIT + number)
            seed = FIRST_DRIVE + TRIES * (place * PER_SPLIT + number)
            drives.append(PaperDrive(f"{split}-{number:03d}", split, map_seed, seed, count))
    return drives


def make_drive(folder: Path, config: SimulatedConfig, drive: PaperDrive) -> dict[str, Any]:
    """Drive, record and write a trajectory, and return its facts for the manifest.

    Raises:
        DriveError: if with every seed the drive ended before the last frame.
    """
    world = generate(FAMILY, drive.map_seed)
    if config.clutter:
        world = cluttered(world, config.clutter, np.random.default_rng(drive.map_seed))
    ends = []
    for seed in range(drive.seed, drive.seed + TRIES):
        try:
            recording, end = frames_of_drive(world, seed, drive.count, config)
        except NoTaskError as error:
            ends.append(str(error))
            continue
        if end is None:
            about = {
                "split": drive.split,
                "map": world.name,
                "map_seed": drive.map_seed,
                "seed": seed,
                "world": world_hash(world.grid.cells),
            }
            return write_trajectory(folder, drive.name, recording.arrays(), about)
        ends.append(f"seed {seed}: {end} after {len(recording)} frames")
    raise DriveError(f"{drive.name}: no seed gave {drive.count} frames; the last: {ends[-1]}")


def frames_of_drive(
    world: World, seed: int, count: int, config: SimulatedConfig
) -> tuple[Recording, str | None]:
    """Drive from goal to goal until there are enough frames.

    Args:
        world: building to drive through.
        seed: seed of the task, the path search, the noise and the people.
        count: number of frames.
        config: noise of the LIDAR, and number of people.

    Returns:
        The frames; and the reason why the drive ended too early, None if it did not.

    Raises:
        NoTaskError: if the building has no route of that length.
    """
    car, lidar = DubinsCar(CarLimits(v_max=SPEED)), Lidar(LidarConfig(range_noise=config.noise))
    # Separate random streams, so that the people do not depend on the noise.
    noise, crowds = (np.random.default_rng([seed, stream]) for stream in (2, 3))
    # The route is longer than the drive, so that the car does not slow down for the goal.
    length = SPEED * TICK * count + 10.0
    first = sample_task(world, seed, car.limits, max_length=LONGEST_LEG)
    task = prolonged(first, length, car.limits)
    start = np.array(task.start)
    settings = NavigatorConfig(
        window=2 * lidar.config.range_max,
        car=car.limits,
        guide=GuideConfig(every=PATH_EVERY),
        bounds=ErrorBounds(range=NOISE_CUT * config.noise),
        start_margin=task.start_margin(car.limits.body),
    )
    navigator = Navigator(
        settings, None, start, task.goal, task.blank(settings.window), task.waypoints, seed
    )
    crowd = People(world, config.people, start[:2], crowds)
    near = task.blank(WINDOW)
    task.mark_start(near, settings.car.body)
    recording = Recording(world.grid.frame, truth_codes(world.grid.free, world.surface))
    state, rested = np.array([*task.start, 0.0]), 0
    turned, within = np.zeros(count + 1), round(CIRCLES[1] / TICK)
    for tick in range(count):
        scan = lidar.scan(world, state, noise, crowd.discs)
        decision = navigator.step(state, scan)
        near.integrate(scan, state)
        action = np.array([decision.control.acceleration, decision.control.curvature])
        recording.add(navigator.known, near, state, action, tick * TICK)
        if car.collides(world, state, decision.control, TICK):
            return recording, "it collided"
        moved = car.step(state, decision.control, TICK)
        crowd.walk(TICK, moved[:2])
        turn = np.remainder(moved[2] - state[2] + np.pi, 2 * np.pi) - np.pi
        turned[tick + 1] = turned[tick] + turn
        state = moved
        if abs(turned[tick + 1] - turned[max(0, tick + 1 - within)]) > 2 * np.pi * CIRCLES[0]:
            return recording, "it went round in circles"
        rested = rested + 1 if state[3] < 0.02 else 0
        if rested > 100:
            return recording, "it stood still for 10 s"
    return recording, None


def _shared(total: int, among: int) -> list[int]:
    """Split a number of frames among drives as evenly as possible."""
    return [total // among + (number < total % among) for number in range(among)]
