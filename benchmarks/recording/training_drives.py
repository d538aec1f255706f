"""Samples to learn from: the car drives through generated buildings, and its LIDAR records.

The car drives by its own planner, without prediction. Each drive is then seen again through LIDARs
of other windows and other noise, which costs a tenth of driving it.
"""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Iterator
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.recording.robot_log import ROBOT, LogConfig, simulated_log
from planner.navigator import Navigator, NavigatorConfig
from predictor.data.drives_config import DrivesConfig
from predictor.data.frames import MANIFEST
from predictor.data.samples import FORMAT, RECIPE, SIDE, encoded, write_samples
from predictor.data.squares import cells_of, codes_of, truth_codes
from predictor.data.survey import REACH, clipped, frame_around, surveyed
from predictor.infra.atomic_file import write_whole
from predictor.infra.errors import LineError
from predictor.infra.plain_json import loads
from predictor.infra.workers import finished
from predictor.mapping.body import Body
from predictor.mapping.grid import Grid, OccupancyGrid, world_hash
from sim import DubinsCar, Lidar, LidarConfig
from sim.episode import EpisodeConfig, run_episode
from sim.families import generate
from sim.task import NoTaskError, sample_task
from sim.variation import varied

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from sim.lidar import LidarConfig
    from sim.task import Task
    from sim.world import World

SPLITS = {"train": 1_200_000, "validation": 520_000}
"""First seed of each split. What is measured and published uses others, below 10,000 and from
700,000 on; the 200,000 before the first and 20,000 before the second made earlier weights."""
WINDOWS = (5.0, 5.0, 5.0, 5.0, 7.0, 10.0, 20.0, 40.0)
"""Sides of the square that the LIDAR writes into [m], drawn from."""
JOURNEYS, APART = (1, 2, 4, 8), 2.0
"""Of a simulated log: ways through its building, drawn from, for some robots have been through each
door and some down one corridor; and from one of its samples to the next [m]."""
SPREAD = 10_000_000
"""From the seed of one of them to the next: no split has as many."""


class DrivesError(LineError):
    """Samples cannot be made; the message is one line."""


def record(config: DrivesConfig, item: tuple[str, int]) -> int:
    """Make one drive's samples and write them; the number of samples.

    Args:
        config: how.
        item: a split, and which of its drives.
    """
    import numpy as np

    split, number = item
    seed = SPLITS[split] + number
    rng = np.random.default_rng(seed)
    family = config.families[number % len(config.families)]
    drawn = generate(family, seed)
    # Half as they are: where they differ from what it learned, the network is ill calibrated.
    world = varied(drawn, rng) if rng.random() < 0.5 else drawn
    make = _logged if config.logs else _driven
    try:
        samples = list(make(config, world, seed, rng))
    except NoTaskError:
        samples = []
    path = path_of(config, item)
    about = {"family": family, "seed": seed, "world": world_hash(world.grid.cells),
             "original": world_hash(drawn.grid.cells)}  # fmt: skip
    write_samples(path, samples, about)
    return len(samples)


def _driven(
    config: DrivesConfig, world: World, seed: int, rng: np.random.Generator
) -> Iterator[bytes]:
    """A drive's samples, of which the building is the truth.

    Raises:
        NoTaskError: if there is nowhere to drive.
    """
    task = sample_task(world, seed)
    # Half the drives rely on all that was not seen occupied: faster, and they end otherwise.
    window, risk = float(rng.choice(WINDOWS)), float(rng.choice([0.0, 1.0]))
    states = driven(task, window, risk, rng, config.longest)
    for _ in range(config.views):
        window = float(rng.choice(WINDOWS))
        noise = float(rng.choice([0.0, 0.0, 0.01, 0.03]))
        lidar = LidarConfig(range_noise=noise, dropout=float(rng.choice([0.0, 0.05])))
        first = int(rng.integers(config.every))
        for known, state in seen_again(task, states, window, lidar, rng, config.every, first):
            side = SIDE * known.frame.resolution
            crop = known.crop(known.frame.square(state[0], state[1], side))
            truth = truth_codes(*task.world.truth(crop.frame))
            yield encoded(crop, truth, float(state[2]))


def _logged(
    config: DrivesConfig, world: World, seed: int, rng: np.random.Generator
) -> Iterator[bytes]:
    """A log's samples, of which the map of the whole log is the truth.

    Raises:
        NoTaskError: if there is nowhere to drive.
    """
    # All but the first may be missing: from some starts there is no way that long.
    tasks = [sample_task(world, seed, ROBOT)]
    for number in range(1, int(rng.choice(JOURNEYS))):
        with contextlib.suppress(NoTaskError):
            tasks.append(sample_task(world, SPREAD * number + seed, ROBOT))
    log = simulated_log(tasks, rng)
    scans = [clipped(scan, REACH) for scan in log.scans]
    frame = frame_around(log.poses, REACH)
    truth = Grid(frame, cells_of(surveyed(frame, scans, log.poses)))
    side = SIDE * frame.resolution
    for _ in range(config.views):
        window = float(rng.choice(WINDOWS))
        first = frame.square(float(log.poses[0, 0]), float(log.poses[0, 1]), window)
        known, gone = OccupancyGrid(first, window), float(rng.uniform(0.0, APART))
        for number, (scan, pose) in enumerate(zip(scans, log.poses, strict=True)):
            known.integrate(scan, pose)
            gone += math.dist(pose[:2], log.poses[max(number - 1, 0), :2])
            if gone >= APART:
                # What is over is kept, but for the jump from one way to the next.
                gone %= APART
                square = frame.square(float(pose[0]), float(pose[1]), side)
                true = codes_of(truth.crop(square).cells)
                yield encoded(known.crop(square), true, float(pose[2]))


def driven(
    task: Task,
    window: float,
    risk: float,
    rng: np.random.Generator,
    longest: float | None = None,
) -> NDArray[np.float64]:
    """The states (T, 4) of a drive without prediction.

    Args:
        task: where.
        window: of the LIDAR [m].
        risk: 0: careful; 1: relying on all that was not seen occupied.
        rng: noise of the LIDAR.
        longest: the drive is broken off after this [s]; None: it goes on to its end.
    """
    import numpy as np

    config = NavigatorConfig(window=window, risk=risk)
    start, car, ending = np.array(task.start), DubinsCar(), EpisodeConfig()
    if longest is not None:
        ending = EpisodeConfig(timeout=longest * car.limits.v_max / task.path_length)
    navigator = Navigator(config, None, start, task.goal, task.blank(window), seed=task.seed)
    episode = run_episode(task, navigator, car, Lidar(), ending, rng)
    states: NDArray[np.float64] = episode.trace["states"][:-1]
    return states


def seen_again(
    task: Task,
    states: NDArray[np.float64],
    window: float,
    lidar: LidarConfig,
    rng: np.random.Generator,
    every: int,
    first: int = 0,
) -> Iterator[tuple[OccupancyGrid, NDArray[np.float64]]]:
    """A drive through another LIDAR: what is known, and the state, every few ticks.

    The grid is one and grows; take from it what is to be kept.
    """
    known, sensor = task.blank(window), Lidar(lidar)
    known.mark_free(task.start, Body(), NavigatorConfig().start_margin)
    for tick, state in enumerate(states):
        known.integrate(sensor.scan(task.world, state, rng), state)
        if tick % every == first:
            yield known, state


def path_of(config: DrivesConfig, item: tuple[str, int]) -> Path:
    """Where a drive's samples are."""
    return config.out / item[0] / f"{item[1]:06d}.npz"


def make(config: DrivesConfig, jobs: int) -> None:
    """Make all that is missing of a set, with a progress bar.

    Raises:
        DrivesError: if the folder holds samples that were made in another way.
    """
    from tqdm import tqdm

    _claim(config)
    items = [(split, n) for split in SPLITS for n in range(getattr(config, split))]
    todo = [item for item in items if not path_of(config, item).exists()]
    count = 0
    with tqdm(total=len(items), initial=len(items) - len(todo), unit="drive") as bar:
        for _, samples in finished(partial(record, config), todo, jobs):
            count += samples
            bar.set_postfix_str(f"{count} samples")
            bar.update()


def _claim(config: DrivesConfig) -> None:
    """Make the folders, and see to it that one folder holds samples of one recipe."""
    if (config.out / MANIFEST).exists():
        raise DrivesError(f"{config.out} holds frames of predictor.dataset: choose another folder")
    for split in SPLITS:
        (config.out / split).mkdir(parents=True, exist_ok=True)
    how = ({"log": asdict(LogConfig()), "journeys": JOURNEYS, "apart": APART} if config.logs else
           {"longest": config.longest, "every": config.every})  # fmt: skip
    recipe = {"format": FORMAT, "seeds": SPLITS, "views": config.views,
              "families": config.families, "windows": WINDOWS}  # fmt: skip
    recipe |= how
    path, mine = config.out / RECIPE, json.loads(json.dumps(recipe))
    try:
        theirs = dict(loads(path.read_text())) if path.exists() else mine
    except (ValueError, TypeError):
        raise DrivesError(f"{path} cannot be read; delete it if you know that the samples beside "
                          "it were made by this command") from None  # fmt: skip
    differ = [key for key in mine | theirs if mine.get(key) != theirs.get(key)]
    if differ:
        raise DrivesError(f"{path} says that its samples were made in another way "
                          f"({', '.join(differ)} differ); choose another folder")  # fmt: skip
    write_whole(path, json.dumps(mine, indent=1).encode())
