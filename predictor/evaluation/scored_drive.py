"""The scores of predictors along one drive, on the cells that the car has not observed yet."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_opening

from foresee.mapping.conventions import RESOLUTION
from foresee.mapping.grid import Grid, world_hash
from foresee.prediction import Caller, Prediction, View, with_observed
from planner.navigator import Navigator
from planner.navigator_config import NavigatorConfig
from predictor.data.squares import TERNARY, truth_codes
from predictor.evaluation.settings import EvaluateConfig
from predictor.networks.compact_net import ROOM_REACH
from predictor.provenance import has_learned
from predictor.recording.rescan import rescanned
from predictor.registry import load_predictor
from predictor.scoring.images import ssim, ternary
from predictor.scoring.scores import Scores, cell_rings
from sim import DubinsCar, Lidar, LidarConfig
from sim.buildings import learned_forms, task_in
from sim.episode import EpisodeConfig, run_episode
from sim.task import NoTaskError, Task

BLANK = "grey"
"""Name in tables for an image that is all grey, as a baseline of SSIM."""
TRUSTED = " (c·p)"
"""Suffix of a predictor's name in a row that scores its probabilities times its confidence."""
AS_ROOM = " (room)"
"""Suffix of a predictor's name in a row that scores confidence · p_free, which the planner uses, as
the probability that a cell lies in a free square as wide as the car."""

VERSION = 3
"""Version of the measures, which changes with the definition of any of them and with the drives."""


def score_drive(
    config: EvaluateConfig, item: tuple[str, int]
) -> tuple[dict[str, Any], dict[str, NDArray[Any]]] | str:
    """Drive once, and return facts and scores; or one line that says why there is no drive.

    Args:
        config: settings of the evaluation.
        item: family of buildings or path of a map file, and seed.

    Raises:
        BadPredictionError: if a predictor breaks its contract, or raises.
    """
    place, seed = item
    try:
        task = task_in(place, seed)
    except NoTaskError as error:
        return str(error)
    world, rng = task.world, np.random.default_rng(seed)
    cells = cells_of_a_car(world.grid.frame.resolution)
    square_of_a_car, reach = np.ones((cells, cells), dtype=bool), cells // 2
    predictors = {name: load_predictor(name) for name in config.predictors}
    callers = {name: Caller(predictor) for name, predictor in predictors.items()}
    scores = {name: Scores() for name in score_rows(config)}
    similar: dict[str, list[float]] = {name: [] for name in (*predictors, BLANK)}
    taken: dict[str, list[float]] = {name: [] for name in predictors}
    side = NavigatorConfig(window=config.window, expansion=config.expansion).predicted_side
    states = _driven(task, config.window, rng)
    moments: list[tuple[float, NDArray[np.uint8]]] = []
    for known, state in rescanned(task, states, config.window, LidarConfig(), rng, config.every):
        square = known.frame.square(state[0], state[1], side)
        crop = known.crop(square)
        ring = cell_rings(crop)
        free, occupied = world.truth(square)
        # Morphological opening; cells outside of the square count as free.
        room = binary_opening(np.pad(free, reach, constant_values=True), square_of_a_car)
        room = room[reach : reach + len(free), reach : reach + len(free)]
        true_image = TERNARY[truth_codes(free, occupied)]
        blank = np.full(true_image.shape, 0.5)
        similar[BLANK].append(ssim(blank, true_image))
        for name, caller in callers.items():
            begin = time.perf_counter()
            view = View.of(known, state[:3], caller.side or side, caller.context_side)
            belief = caller.ask(view)
            taken[name].append(1e3 * (time.perf_counter() - begin))
            if caller.side:
                belief = _on(belief, crop)
            image = ternary(crop, belief)
            similar[name].append(ssim(image, true_image))
            trusted = belief.confidence * belief.p_free, belief.confidence * belief.p_occupied
            scores[name].add(belief.p_free, belief.p_occupied, free, occupied, ring)
            scores[name + TRUSTED].add(*trusted, free, occupied, ring)
            scores[name + AS_ROOM].add(trusted[0], 1.0 - trusted[0], room, ~room, ring)
            if name == config.predictors[-1] and (ring >= 0).any():
                off = float(((belief.p_free - free)[ring >= 0] ** 2).mean())
                moments.append((off, _picture(ternary(crop, None), image, true_image)))
    arrays = {key: value for name in scores for key, value in scores[name].arrays(name).items()}
    moments.sort(key=lambda entry: entry[0])
    shown = [moments[0], moments[len(moments) // 2], moments[-1]] if moments else []
    arrays |= {f"picture/{i}": picture for i, (_, picture) in enumerate(shown)}
    building = world.grid.cells
    facts = {
        "world": world.name,
        "hash": world_hash(building),
        "learned_by": [
            name for name, p in predictors.items() if has_learned(p, learned_forms(world))
        ],
        "moments": len(similar[BLANK]),
        "ssim": {k: float(np.mean(v)) for k, v in similar.items()},
        "ms": {k: float(np.median(v)) for k, v in taken.items()},
        "errors": [off for off, _ in shown],
    }
    return facts, arrays


def _on(belief: Prediction, known: Grid) -> Prediction:
    """Return a prediction on the frame of a map; cells outside of its own are unknown."""
    there, here = belief.frame.overlap(known.frame)
    given = belief.p_free, belief.p_occupied, belief.confidence
    free, occupied, confidence = fields = np.zeros((3, *known.frame.shape), dtype=np.float32)
    for field, values in zip(fields, given, strict=True):
        field[here] = values[there]
    return with_observed(known, free, occupied, confidence, belief.nan_cells, belief.doubt)


def cells_of_a_car(resolution: float) -> int:
    """Return the side of a square as wide as the car, in cells of a resolution [m], rounded up."""
    return math.ceil((2 * ROOM_REACH + 1) * RESOLUTION / resolution - 1e-6)


def score_rows(config: EvaluateConfig) -> list[str]:
    """Return the names of the rows of scores, three for each predictor."""
    return [name + end for name in config.predictors for end in ("", TRUSTED, AS_ROOM)]


def _picture(*images: NDArray[np.float64]) -> NDArray[np.uint8]:
    return np.rint(255 * np.stack(images)).astype(np.uint8)


def _driven(task: Task, window: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Drive without prediction, and return the states (T, 4).

    Args:
        task: building, start and goal.
        window: side of the square in which the LIDAR is used [m].
        rng: generator of the LIDAR's noise.
    """
    start, car = np.array(task.start), DubinsCar()
    margin = task.start_margin(car.limits.body)
    config = NavigatorConfig(window=window, reliance=0.0, start_margin=margin)
    navigator = Navigator(config, None, start, task.goal, task.blank(window), seed=task.seed)
    episode = run_episode(task, navigator, car, Lidar(), EpisodeConfig(), rng)
    states: NDArray[np.float64] = episode.trace["states"][:-1]
    return states
