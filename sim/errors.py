"""Errors of a simulated robot: controls that act late and with a lag, and estimates of the pose."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.control import Control
from foresee.mapping.error_bounds import NO_ERRORS, ErrorBounds
from sim.car import wrap

LAG_STEP = 0.01
"""Longest time over which a lagging control counts as constant [s]."""
STEP, JUMP = 0.1, 0.02
"""Size of a tick's change of a drifting pose error, and probability of a jump in a tick; the size
is a share of the bound."""


@dataclass(frozen=True)
class Errors:
    """Errors of a simulated robot. By default there are none.

    Attributes:
        bounds: bounds that the errors keep to. The delay is exact; each control may take up to
            `bounds.jitter` longer.
        missed: probability that there is no decision in a tick, in [0, 1].
        most_missed: number of ticks without a decision in succession, at most.
    """

    bounds: ErrorBounds = NO_ERRORS
    missed: float = 0.0
    most_missed: int = 3

    def __post_init__(self) -> None:
        if not 0.0 <= self.missed <= 1.0:
            raise ValueError(f"missed is {self.missed}, it must lie in [0, 1]")


class Actuators:
    """Carries out controls late, and with a lag.

    Args:
        bounds: bounds of the errors; without any, each control acts at once.
        rng: source of the delays.
    """

    def __init__(self, bounds: ErrorBounds, rng: np.random.Generator) -> None:
        self.bounds, self.rng = bounds, rng
        self._time = 0.0
        self._acting = Control(0.0, 0.0)
        self._coming = deque[tuple[float, Control]]()
        self._acceleration = self._curvature = 0.0

    def during(self, control: Control, dt: float, moving: bool) -> Iterator[tuple[Control, float]]:
        """Yield the controls that act in the next tick, each with its duration [s].

        Args:
            control: control that is sent at its start.
            dt: length of the tick [s].
            moving: whether the car moves at its start.
        """
        b = self.bounds
        if b.moves_exactly and b.delay == 0.0:
            yield control, dt
            return
        delay = b.delay + b.jitter * self.lateness(control)
        # A control never overtakes the one before.
        earliest = self._coming[-1][0] if self._coming else 0.0
        self._coming.append((max(self._time + delay, earliest), control))
        end = self._time + dt
        if not moving:
            self._acceleration = max(self._acceleration, 0.0)
        while self._time < end - 1e-9:
            while self._coming and self._coming[0][0] <= self._time + 1e-9:
                self._acting = self._coming.popleft()[1]
            until = min(end, self._coming[0][0]) if self._coming else end
            if b.lag > 0.0:
                until = min(until, self._time + LAG_STEP)
            span = until - self._time
            yield self._lagging(span), span
            self._time = until

    def lateness(self, control: Control) -> float:
        """Return the share of the jitter by which a control is late, in [0, 1]."""
        # The extremes are the worst.
        return float(self.rng.integers(2))

    def _lagging(self, span: float) -> Control:
        """Return the mean control over a time [s] in which the response follows its command."""
        acting, lag = self._acting, self.bounds.lag
        if lag == 0.0:
            return acting
        # The mean of an exponential approach over the span.
        left = math.exp(-span / lag)
        mean = (1.0 - left) * lag / span
        off = self._acceleration - acting.acceleration, self._curvature - acting.curvature
        self._acceleration = acting.acceleration + off[0] * left
        self._curvature = acting.curvature + off[1] * left
        a, kappa = acting.acceleration + off[0] * mean, acting.curvature + off[1] * mean
        return Control(a, kappa, acting.gear, acting.turn_rate)


class PoseEstimate:
    """Estimates the pose of a robot with an error that drifts and jumps within its bounds.

    Args:
        bounds: bounds of the errors.
        rng: source of the errors.
    """

    def __init__(self, bounds: ErrorBounds, rng: np.random.Generator) -> None:
        self.bounds, self.rng = bounds, rng
        self._share = np.zeros(3)
        """Error of x, y and yaw, as a share of its bound."""

    def of(self, state: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return an estimate of a state x, y, yaw, v (4,); the speed is exact."""
        b, rng = self.bounds, self.rng
        if b.position == b.yaw == 0.0:
            return state
        if rng.random() < JUMP:
            bearing = rng.uniform(-math.pi, math.pi)
            self._share = np.array([math.cos(bearing), math.sin(bearing), rng.choice([-1, 1])])
        else:
            self._share = self._share + STEP * rng.standard_normal(3)
        off = math.hypot(self._share[0], self._share[1])
        self._share[:2] /= max(off, 1.0)
        self._share[2] = min(max(self._share[2], -1.0), 1.0)
        x, y = b.position * self._share[:2]
        yaw = wrap(float(state[2] + b.yaw * self._share[2]))
        return np.array([state[0] + x, state[1] + y, yaw, state[3]])


class Robot:
    """The errors of a simulated robot during one drive.

    Args:
        errors: errors of sensing and motion.
        rng: source of the errors.
    """

    def __init__(self, errors: Errors, rng: np.random.Generator) -> None:
        self.errors, self.rng = errors, rng
        self.actuators = Actuators(errors.bounds, rng)
        self.estimate = PoseEstimate(errors.bounds, rng).of
        self._missed = -1
        """Number of ticks without a decision up to now; -1 before the first decision."""

    def misses(self) -> bool:
        """Return whether there is no decision in the next tick; in the first there always is."""
        if self.errors.missed == 0.0:
            return False
        first, self._missed = self._missed < 0, max(self._missed, 0)
        missed = not first and self.rng.random() < self.errors.missed
        if not missed or self._missed >= self.errors.most_missed:
            self._missed = 0
            return False
        self._missed += 1
        return True
