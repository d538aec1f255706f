"""The worst errors of a robot within their bounds, drawn by an adversary that knows the building.

Each drive of the attack has one way to be wrong of each kind: always at a bound, alternating
between the two, or at the one that brings the car nearer to the nearest wall.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import distance_transform_edt

from benchmarks.runs.settings import Settings
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.control import Control
from foresee.mapping.conventions import NOISE_CUT
from foresee.mapping.error_bounds import ErrorBounds
from foresee.mapping.scan import Scan
from sim import DubinsCar, Lidar
from sim.car import wrap
from sim.errors import Actuators, Errors, Robot
from sim.lidar import LidarConfig
from sim.world import World

MOST = {
    "delay": 0.3,
    "jitter": 0.05,
    "lag": 0.2,
    "pose_error": 0.05,
    "yaw_error": 0.02,
    "noise": 0.03 / NOISE_CUT,
    "dropout": 0.2,
    "missed": 0.2,
}
"""Largest value of each setting of errors that is drawn; units as in `Settings`."""
LONGEST_BURST = 12
"""Largest number of ticks without a decision in succession."""
POSES = ("away", "towards", "near", "jumps", "drifts", "behind")
"""Ways of being wrong about the position. away: the car seems farther from the nearest wall than it
is; towards: nearer; near: nearer far from walls, so that they seem farther, and farther near them;
jumps: from one of these to the other; drifts: all round; behind: ahead of the true place while the
car speeds up, and behind it while it brakes."""
YAWS = ("from the wall", "to the wall", "near", "jumps")
"""Ways of being wrong about the yaw: the heading that seems farther from the nearest wall than it
is leads the car to it."""
TIMES = ("early", "late", "alternating", "random", "worst")
"""When in the jitter a control acts. worst: late if it brakes harder or turns, else early."""
RANGES = ("long", "short", "alternating", "random")
"""Signs of the error of ranges: one for all, one for each scan, one for each beam."""


@dataclass(frozen=True)
class WorstErrors:
    """How the errors of a drive are wrong; how much is said by its settings.

    Attributes:
        pose: one of `POSES`.
        yaw: one of `YAWS`.
        time: one of `TIMES`.
        range: one of `RANGES`.
        near: distance from the nearest wall below which the car is near it [m].
    """

    pose: str
    yaw: str
    time: str
    range: str
    near: float

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        """Draw ways of being wrong."""
        pose, yaw, time, signs = (str(rng.choice(ways)) for ways in (POSES, YAWS, TIMES, RANGES))
        return cls(pose, yaw, time, signs, float(rng.uniform(0.3, 1.5)))


def drawn_errors(rng: np.random.Generator) -> dict[str, Any]:
    """Draw settings of errors: each is there or not, and often as large as it may be."""
    return {
        name: round(most * float(rng.choice([0.0, rng.random(), 1.0])), 4)
        for name, most in MOST.items()
    }


class WorstRobot(Robot):
    """A robot whose errors are the worst within their bounds.

    Args:
        worst: ways of being wrong.
        settings: settings of the drive, with the bounds.
        world: building, whose walls the adversary knows.
        rng: source of the errors.
    """

    def __init__(
        self, worst: WorstErrors, settings: Settings, world: World, rng: np.random.Generator
    ) -> None:
        bounds = settings.bounds
        super().__init__(Errors(bounds, settings.missed, LONGEST_BURST), rng)
        self.actuators = _WorstActuators(worst.time, bounds, rng)
        self.estimate = _WorstEstimate(worst, bounds, world, rng).of
        self._burst = 0

    def misses(self) -> bool:
        """Return whether there is no decision in the next tick: they are missed in bursts."""
        started, self._missed = self._missed >= 0, 0
        if started and self._burst == 0 and self.rng.random() < 0.2 * self.errors.missed:
            self._burst = int(self.rng.integers(1, self.errors.most_missed + 1))
            return True
        self._burst = max(self._burst - 1, 0)
        return self._burst > 0


class _WorstActuators(Actuators):
    """Carries out controls at the extremes of the delay."""

    def __init__(self, time: str, bounds: ErrorBounds, rng: np.random.Generator) -> None:
        super().__init__(bounds, rng)
        self._times, self._number = time, 0
        self._before = Control(0.0, 0.0)

    def lateness(self, control: Control) -> float:
        before, self._before = self._before, control
        self._number += 1
        match self._times:
            case "early":
                return 0.0
            case "late":
                return 1.0
            case "alternating":
                return float(self._number % 2)
            case "random":
                return super().lateness(control)
        brakes = control.acceleration < before.acceleration
        return float(brakes or abs(control.curvature) > abs(before.curvature))


class _WorstEstimate:
    """Estimates poses at the bounds of their errors."""

    def __init__(
        self, worst: WorstErrors, bounds: ErrorBounds, world: World, rng: np.random.Generator
    ) -> None:
        self.worst, self.bounds, self.world, self.rng = worst, bounds, world, rng
        # The nearest solid cell of each cell, (2, rows, columns).
        self._nearest = distance_transform_edt(
            ~world.solid, return_distances=False, return_indices=True
        )
        self._speed = 0.0
        self._side = 1.0
        self._tick = 0

    def of(self, state: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return an estimate of a state x, y, yaw, v (4,); the speed is exact."""
        self._tick += 1
        if self.rng.random() < 0.3:
            self._side = -self._side
        frame = self.world.grid.frame
        row, col = frame.cell(float(state[0]), float(state[1]))
        rows, cols = frame.shape
        at = min(max(row, 0), rows - 1), min(max(col, 0), cols - 1)
        wall = np.array(frame.centre(*self._nearest[(slice(None), *at)])) - state[:2]
        off = max(float(np.hypot(*wall)), 1e-9)
        side = {"near": 1.0 if off < self.worst.near else -1.0, "jumps": self._side}
        ahead = np.array([math.cos(state[2]), math.sin(state[2])])
        match self.worst.pose:
            case "drifts":
                turn = 0.3 * self._tick
                error = np.array([math.cos(turn), math.sin(turn)])
            case "behind":
                slower = abs(float(state[3])) < self._speed
                error = (-1.0 if slower else 1.0) * ahead
            case pose:
                away = {"away": 1.0, "towards": -1.0} | side
                error = -away[pose] * wall / off
        self._speed = abs(float(state[3]))
        left = 1.0 if ahead[0] * wall[1] - ahead[1] * wall[0] > 0.0 else -1.0
        away = {"from the wall": 1.0, "to the wall": -1.0} | side
        yaw = float(state[2]) - self.bounds.yaw * left * away[self.worst.yaw]
        # Short of the bound by what rounding may add.
        x, y = (1.0 - 1e-12) * self.bounds.position * error
        return np.array([state[0] + x, state[1] + y, wrap(yaw), state[3]])


class WorstLidar(Lidar):
    """A LIDAR whose ranges are wrong by as much as they may be.

    Args:
        config: settings of the LIDAR, without noise.
        sign: one of `RANGES`.
        bound: largest error of a range [m].
    """

    def __init__(self, config: LidarConfig, sign: str, bound: float) -> None:
        super().__init__(config)
        self._sign, self._bound, self._number = sign, bound, 0

    def scan(
        self,
        world: World,
        pose: ArrayLike,
        rng: np.random.Generator | None = None,
        discs: NDArray[np.float64] | None = None,
    ) -> Scan:
        """Take a scan, as `Lidar.scan` does."""
        exact = super().scan(world, pose, rng, discs)
        self._number += 1
        signs = {"long": 1.0, "short": -1.0, "alternating": 1.0 - 2.0 * (self._number % 2)}
        sign = np.full(exact.ranges.shape, signs.get(self._sign, 1.0))
        if self._sign == "random" and rng is not None:
            sign = rng.choice([-1.0, 1.0], sign.shape)
        wrong = np.clip(exact.ranges + sign * self._bound, 0.0, np.nextafter(exact.range_max, 0.0))
        return replace(exact, ranges=np.where(np.isfinite(exact.ranges), wrong, exact.ranges))


class TracedCar(DubinsCar):
    """A simulated car that remembers its states, of which a tick with errors has several.

    Args:
        limits: the car's limits and its body.
        start: x, y, yaw at which it stands.
    """

    def __init__(self, limits: CarLimits, start: tuple[float, float, float]) -> None:
        super().__init__(limits)
        self.states = [np.array([*start, 0.0])]

    def step(self, state: ArrayLike, control: Control, dt: float) -> NDArray[np.float64]:
        """Return the state after a step, as `DubinsCar.step` does."""
        self.states.append(super().step(state, control, dt))
        return self.states[-1]
