"""A robot's log, replayed: what the car would have observed and predicted along it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from foresee.infra.environment import commit
from foresee.infra.progress import progress
from foresee.mapping.conventions import TICK
from foresee.mapping.grid import OccupancyGrid
from foresee.prediction import Caller, View
from planner.navigator_config import NavigatorConfig
from predictor.data.laser_log import LaserLog
from predictor.data.mcap_file import LASER, writing_mcap
from predictor.data.survey import REACH, clipped, frame_around
from predictor.evaluation.settings import ReplayConfig
from predictor.registry import fingerprint_of, load_predictor

PACE = 1.0
"""Speed at which a robot is taken to have driven if its log has no usable clock [m/s]."""
EARLY = 1e-3
"""Share of the period of the maps by which one may come early, since clocks jitter."""


@dataclass(frozen=True)
class Replay:
    """What the replay of a log wrote.

    Attributes:
        scans: number of scans.
        maps: number of observed maps, and of predictions.
        duration: time from the first scan to the last [s].
        nan_cells: number of unobserved cells of all predictions that were NaN.
    """

    scans: int
    maps: int
    duration: float
    nan_cells: int


def scan_times(log: LaserLog) -> NDArray[np.float64]:
    """Return the times of the scans of a log, (n,) [s].

    If the log's clock cannot be used, they are those of a robot that drives straight from scan to
    scan at `PACE`, at least a tick apart.
    """
    if log.times is not None:
        return log.times
    steps = np.hypot(*np.diff(log.poses[:, :2], axis=0).T)
    return TICK + np.concatenate([[0.0], np.cumsum(np.maximum(TICK, steps / PACE))])


def mapped_scans(times: NDArray[np.float64], every: int, rate: float) -> list[int]:
    """Return the numbers of the scans at which maps are written; the last is one of them.

    Args:
        times: times of the scans, (n,) [s].
        every: maps are written at every n-th scan,
        rate: unless there would be more than this many a second.
    """
    period = (1.0 - EARLY) / rate
    chosen: list[int] = []
    for number in range(0, len(times), every):
        if not chosen or times[number] - times[chosen[-1]] >= period:
            chosen.append(number)
    return sorted({*chosen, len(times) - 1})


def replay(log: LaserLog, config: ReplayConfig, path: Path) -> Replay:
    """Map the scans of a log as the car does, predict, and write an MCAP file, with a progress bar.

    As in frames of logs, ranges are cut off at `REACH`, and no cells count as observed but those
    that a beam reached: the robot's body is not known.

    Args:
        log: scans and their poses.
        config: settings of the replay.
        path: path of the file, in a folder that exists; it is replaced if it exists.

    Raises:
        PredictorError: if there is no such predictor.
        BadPredictionError: if the predictor raises, or breaks its contract.
        LogError: if the poses lie too far apart.
        McapError: if the file cannot be written, as without rosbags.
    """
    predictor = load_predictor(config.predictor)
    caller = Caller(predictor)
    side = caller.side or _predicted_side(config)
    x, y, _ = log.poses[0].tolist()
    known = OccupancyGrid(frame_around(log.poses, REACH).square(x, y, 2 * REACH), config.window)
    times = scan_times(log)
    mapped = set(mapped_scans(times, config.every, config.rate))
    about = asdict(config) | {
        "log": log.name,
        "clock": log.times is not None,
        "weights": fingerprint_of(config.predictor),
        "commit": commit(),
    }
    nan_cells = 0
    with writing_mcap(path, {"foresee": about}) as file:
        scans = zip(log.scans, log.poses, times.tolist(), strict=True)
        for number, (scan, pose, time) in enumerate(progress(scans, total=len(log), unit="scan")):
            known.integrate(clipped(scan, REACH), pose)
            file.place(time, pose, LASER)
            file.scan(time, scan)
            if number in mapped:
                prediction = caller.ask(View.of(known, pose, side, caller.context_side))
                nan_cells += prediction.nan_cells
                file.observed(time, known)
                file.predicted(time, prediction)
    return Replay(len(log), len(mapped), float(times[-1] - times[0]), nan_cells)


def _predicted_side(config: ReplayConfig) -> float:
    """Return the side of the square that the car predicts [m]."""
    return NavigatorConfig(window=config.window, expansion=config.expansion).predicted_side
