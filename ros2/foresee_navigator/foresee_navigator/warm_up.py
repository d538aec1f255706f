"""The warm-up: compile and load all that a tick needs, before the robot relies on it."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from foresee_navigator.forecast import Forecaster
from foresee_navigator.maps import observed_values, predicted_values
from foresee_navigator.pilot import Mode, Pilot
from foresee_navigator.poses import Motion
from foresee_navigator.prompt_predictor import PromptPredictor
from foresee_navigator.settings import NavigatorSettings
from sim import DubinsCar, Lidar, LidarConfig, empty_straight

LENGTH, WIDTH = 16.0, 4.0
"""Sides of the simulated corridor [m]."""
START = (7.0, 2.5, 0.0)
"""Start of both drives: x, y, yaw [m, m, rad]."""
GOALS = ((13.0, 2.5), (2.0, 2.5))
"""Goals ahead of the start and behind it [m]: for the second, the car must turn round."""
TICKS = 120
"""Longest drive [ticks]."""


def warm_up(settings: NavigatorSettings, predictor: PromptPredictor | None) -> float:
    """Drive through a simulated corridor, and return how long it took [s].

    The first tick of a new installation compiles for minutes; later ones load what was compiled.

    Args:
        settings: settings of the node.
        predictor: predictor of the node, which is warm afterwards.
    """
    started = time.perf_counter()
    car = settings.car
    world = empty_straight(LENGTH, WIDTH)
    lidar, simulated = Lidar(LidarConfig(mount=settings.mount)), DubinsCar(car)
    config = replace(settings.navigator, start_margin=0.5)
    for goal in GOALS:
        pilot = Pilot(config, predictor, settings.resolution, settings.goal_radius)
        pilot.head_for(goal)
        state = np.array([*START, 0.0])
        for _ in range(TICKS):
            action = pilot.act(state, lidar.scan(world, state))
            if action.decision is None or action.mode is not Mode.DRIVING:
                break
            if action.decision.prediction is not None:
                predicted_values(action.decision.prediction, settings.confidence)
            state = simulated.step(state, action.decision.control, 0.1)
        if pilot.known is not None:
            observed_values(pilot.known.log_odds)
    if settings.predict_only:
        motion = Motion(0.0, START, 0.0, 0.0)
        forecaster = Forecaster(config, predictor, settings.resolution)
        forecaster.look(motion, lidar.scan(world, START))
    if predictor is not None:
        predictor.is_warm = True
    return time.perf_counter() - started
