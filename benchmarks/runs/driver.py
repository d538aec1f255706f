"""The driver of an arm: its navigator, and the predictor that it asks."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import replace

import numpy as np

from benchmarks.runs.arms import Arm
from benchmarks.runs.car import limits_for
from benchmarks.runs.oracle import Oracle
from benchmarks.runs.settings import Settings
from foresee.frontiers import FrontierPredictor
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.grid import OccupancyGrid
from foresee.prediction import Predictor
from planner.navigator import Navigator
from planner.navigator_config import NavigatorConfig
from planner.risk.ask_predictor import Asker
from predictor.free import Free
from predictor.registry import load_predictor
from sim.task import Task


def navigator_config(settings: Settings, arm: Arm) -> NavigatorConfig:
    """Return the settings of an arm's navigator.

    Args:
        settings: settings of the run.
        arm: arm that drives.
    """
    reliance = settings.reliance if arm.reliance is None else arm.reliance
    if arm.level is None:
        level = settings.level
        # At least the level, since a plan may enter all cells that its last resort may enter.
        reliance = max(reliance, level)
    else:
        # At a reliance of 1 there is no last resort.
        level = min(arm.level, reliance) if reliance < 1.0 else 0.0
    return NavigatorConfig(
        window=settings.window,
        expansion=settings.expansion,
        reliance=reliance,
        level=level,
        adapt=arm.takes_risk and not settings.fixed_level,
        steer=arm.steer,
        bounds=settings.told_bounds,
        car=limits_for(settings),
    )


def predictor_for(settings: Settings, arm: Arm, task: Task) -> Predictor | None:
    """Return the predictor of an arm in a task; None: it has none.

    Raises:
        PredictorError: if the chosen predictor cannot be loaded.
    """
    if arm.predictor == "chosen":
        return load_predictor(settings.predictor)
    others: dict[str, Predictor] = {"free": Free(), "oracle": Oracle(task.world, arm.side)}
    return others.get(arm.predictor)


def navigator_for(
    settings: Settings,
    arm: Arm,
    task: Task,
    predictor: Predictor | Asker | None,
    deadline: float,
    frontiers: FrontierPredictor | None = None,
    car: CarLimits | None = None,
    executor: Executor | None = None,
) -> Navigator:
    """Return the navigator of an arm at the start of a task.

    Args:
        settings: settings of the run.
        arm: arm that drives.
        task: building, start, goal and route.
        predictor: predictor of the arm, or what asks it; None: it has none.
        deadline: time that a prediction may take [s].
        frontiers: predictor of frontiers of the arm; None: it has none.
        car: limits of the car; None: those of the settings.
        executor: runs the path searches beside the control; None: they run in its order.
    """
    truth, window = task.world.grid, settings.window
    config = navigator_config(settings, arm)
    config = replace(config, car=car or config.car)
    # The driver is told no more free space around the start than there is.
    start_margin = min(config.start_margin, task.start_margin(config.car.body))
    config = replace(config, deadline=deadline, start_margin=start_margin)
    known = OccupancyGrid.from_grid(truth, window) if arm.whole_map else task.blank(window)
    waypoints = task.waypoints if settings.route == "fixed" else None
    start = np.array(task.start)
    return Navigator(
        config,
        predictor,
        start,
        task.goal,
        known,
        waypoints,
        task.seed,
        frontiers,
        executor,
    )
