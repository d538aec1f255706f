"""The forecast: predictions and a speed limit for another planner, which drives."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from foresee.mapping.body import Scene, first_contact
from foresee.mapping.car_limits import CONTACT_MARGIN, CarLimits
from foresee.mapping.conventions import TICK
from foresee.mapping.grid import OccupancyGrid
from foresee.mapping.scan import Scan
from foresee.prediction import Prediction, View
from foresee_navigator.mapping import new_map, observe
from foresee_navigator.poses import Motion
from planner.fault import Fault
from planner.navigator_config import RISK_MAP_AHEAD, NavigatorConfig
from planner.risk.newest_prediction import NewestPrediction
from planner.risk.predictor_process import PredictorProcess
from planner.risk.risk_map import RiskMap

CREEPING = 0.1
"""Speed below which the curvature of the motion is not known, and taken as 0 [m/s]."""


@dataclass(frozen=True, eq=False)
class Forecast:
    """What is said to the other planner.

    Attributes:
        speed_limit: highest speed from which the robot stops in cells that it may enter, if it
            brakes on the arc that it drives [m/s].
        prediction: prediction; None if there is none.
        faults: faults that were handled.
    """

    speed_limit: float
    prediction: Prediction | None
    faults: tuple[Fault, ...]


class Forecaster:
    """Maps what the robot sees, and says how fast it may be.

    Args:
        config: settings; `reliance` and `bounds` decide which cells the robot may enter.
        predictor: predictor; None: no predictions.
        resolution: side of a cell of the map [m].

    Attributes:
        known: observed map; None: nothing was observed.
    """

    def __init__(
        self,
        config: NavigatorConfig,
        predictor: PredictorProcess | None,
        resolution: float,
    ) -> None:
        self.known: OccupancyGrid | None = None
        self._config, self._resolution = config, resolution
        self._predictor = None if predictor is None else NewestPrediction(predictor)

    def forget(self) -> None:
        """Begin a new map, since the old one does not fit the poses any more."""
        self.known = None

    def look(self, motion: Motion, scan: Scan) -> Forecast:
        """Add a scan to the map, and return the forecast.

        Args:
            motion: motion of the robot.
            scan: scan, as seen from that pose.
        """
        config = self._config
        if self.known is None:
            self.known = new_map(config, self._resolution, motion.state)
        read = observe(self.known, scan, motion.state, config)
        faults: tuple[Fault, ...] = () if read else (Fault.BAD_SCAN,)
        prediction, more = self._predict(motion)
        x, y, yaw = motion.pose
        centre = x + RISK_MAP_AHEAD * math.cos(yaw), y + RISK_MAP_AHEAD * math.sin(yaw)
        seen = self.known.crop(self.known.frame.square(*centre, config.risk_side))
        risk = RiskMap.from_prediction(seen, prediction, config.reliance)
        free = free_distance(risk, motion, config.car)
        bounds = config.bounds
        limit = fastest(free, config.car, bounds.delay + bounds.jitter + bounds.lag + TICK)
        return Forecast(limit, prediction, (*faults, *more))

    def _predict(self, motion: Motion) -> tuple[Prediction | None, tuple[Fault, ...]]:
        """Return the predictor's newest answer, or None if it fails, and the faults."""
        if self._predictor is None or self.known is None:
            return None, ()
        asker = self._predictor.asker
        side = asker.side or self._config.predicted_side
        view = View.of(self.known, np.array(motion.pose), side, asker.context_side)
        return self._predictor.ask(view, self._config.deadline)


def free_distance(risk: RiskMap, motion: Motion, car: CarLimits) -> float:
    """Return how far the body moves on its arc before it leaves the safe cells [m].

    Args:
        risk: risk map around the robot.
        motion: motion of the robot, which decides the arc; forward if it stands.
        car: the car's limits and its body.
    """
    gear = -1.0 if motion.speed < -CREEPING else 1.0
    moves = abs(motion.speed) > CREEPING
    curvature = motion.yaw_rate / motion.speed if moves else 0.0
    spacing = car.spacing(CONTACT_MARGIN)
    steps = np.arange(1 + math.ceil(max(risk.frame.size) / spacing))
    arc = Motion(0.0, motion.pose, gear, gear * curvature)
    poses = np.array([arc.after(step * spacing).pose for step in steps])
    halves = car.body.inflated(CONTACT_MARGIN).halves
    scene = Scene(~risk.safe, *risk.frame.lattice, *halves)
    first = int(first_contact(scene, poses))
    return spacing * (len(steps) if first < 0 else max(0, first - 1))


def fastest(distance: float, car: CarLimits, delay: float) -> float:
    """Return the highest speed from which the car stops within a distance [m/s].

    Args:
        distance: distance [m].
        car: the car's limits.
        delay: time before it begins to brake [s].
    """
    lost = car.braking * delay
    speed = math.sqrt(lost**2 + 2.0 * car.braking * distance) - lost
    # Rounding may lead below 0.
    return min(car.v_max, max(0.0, speed))
