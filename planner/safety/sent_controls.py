"""Controls that were sent, and the state of the car when the next one will act."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.car_limits import CarLimits
from foresee.mapping.control import Control
from foresee.mapping.error_bounds import ErrorBounds
from planner.motion.dynamics import rollout
from planner.motion.plan import mirrored
from planner.safety.tube import EXACT, LEAST, SETTLED, Tube, lag_shares, widened


class _Motion(NamedTuple):
    """State x, y, yaw, v of the car (4,), and its acceleration [m/s²] and curvature [1/m]."""

    state: NDArray[np.float64]
    acceleration: float
    curvature: float


class _Acting(NamedTuple):
    """A sent control, when it begins to act, and for how long it does in some time from now [s]."""

    control: Control
    begin: float
    spent: float


class SentControls:
    """Remembers the controls that were sent, and predicts where the next one will act.

    A control acts only after `ErrorBounds.shift`, and the car follows it with a lag. Until then the
    car does what it was told before.

    Args:
        car: limits and body of the car.
        bounds: bounds of its errors.
        dt: length of a tick [s].
    """

    def __init__(self, car: CarLimits, bounds: ErrorBounds, dt: float) -> None:
        self.car, self.bounds, self.dt = car, bounds, dt
        memory = bounds.shift + 0.5 * bounds.jitter + SETTLED * bounds.lag
        # One more, from which the oldest of these differs.
        count = math.ceil(memory / dt - 1e-9) + 1
        standing = Control(-car.braking, 0.0)
        self._sent = deque([standing] * count, maxlen=count)
        self._motion = _Motion(np.zeros(4), 0.0, 0.0)

    def add(self, control: Control) -> None:
        """Add the control that was sent in this tick, at the end of the tick."""
        self._sent.append(control)
        if self.bounds.moves_exactly:
            # Only the state then counts, which is measured anew.
            return
        for control, _, spent in self._acting(self.dt, newest=0):
            if spent > 0.0:
                self._motion = self._after(self._motion, control, spent)

    @property
    def holds(self) -> bool:
        """Whether a car that stands stays there: all controls that may still act brake."""
        _, *acting = self._sent
        return self.bounds.moves_exactly or all(c.acceleration < 0.0 for c in acting)

    def at_effect(self, state: NDArray[np.float64]) -> tuple[NDArray[np.float64], Tube]:
        """Predict the state in which the control of this tick will act.

        Args:
            state: estimated x, y, yaw, v of the car in this tick, (4,).

        Returns:
            The state in which plans begin, and their tube.
        """
        bounds = self.bounds
        self._motion = motion = self._motion._replace(state=state)
        exact = bounds.senses_exactly and bounds.moves_exactly
        if exact and bounds.delay == 0.0:
            return state, EXACT
        reach = self.car.body.radius
        tube = EXACT._replace(
            half=0.5 * bounds.jitter, reach=reach, braking=self.car.braking, lag=bounds.lag
        )
        radius, yaw, slip, speed = bounds.apart(reach), bounds.yaw, 0.0, 0.0
        before = self._sent[0]
        for control, begin, spent in self._acting(bounds.shift, newest=1):
            v, bent = abs(float(motion.state[3])), motion.curvature
            if spent > 0.0:
                motion = self._after(motion, control, spent)
            half = tube.half
            if begin + half <= 0.0:
                # A control that has acted for sure has left its mark on the state already, but for
                # what the lag has still to let through.
                half *= math.exp(begin / bounds.lag) if bounds.lag > 0.0 else 0.0
            radius, yaw, slip, speed = widened(
                tube._replace(half=half),
                *(radius, yaw, slip, speed, v),
                abs(control.acceleration - before.acceleration),
                abs(control.curvature - before.curvature),
                abs(motion.curvature - bent) if spent > 0.0 else 0.0,
                0.5 * (v + abs(float(motion.state[3]))) * spent,
                spent,
            )
            before = control
        start = ahead = motion.state
        if bounds.lag > 0.0:
            # In the long run, a lag is a delay: until its time constant has passed, the car goes on
            # as it does.
            on = Control(motion.acceleration, motion.curvature, before.gear)
            ahead = self._held(start, on, bounds.lag)
        if exact:
            return ahead, EXACT
        # The brakes of a car that stands for sure do not hold it back once they are released.
        stands = speed == 0.0 and abs(float(start[3])) < LEAST
        return ahead, tube._replace(
            radius=radius,
            yaw=yaw,
            slip=slip,
            speed=speed,
            acceleration=max(before.acceleration, 0.0) if stands else before.acceleration,
            curvature=before.curvature,
            start=tuple(start.tolist()),
            response=(motion.acceleration, motion.curvature),
        )

    def _acting(self, duration: float, newest: int) -> Iterator[_Acting]:
        """Yield the sent controls but the oldest, and how long they act in the next time.

        Args:
            duration: the time, from now [s].
            newest: age of the newest control, in ticks.
        """
        dt, count = self.dt, len(self._sent)
        for number, control in enumerate(self._sent):
            back = count - 1 - number + newest
            begin = self.bounds.shift - back * dt
            spent = min(begin + dt, duration) - max(begin, 0.0)
            if number > 0:
                yield _Acting(control, begin, spent if spent > 1e-9 else 0.0)

    def _after(self, motion: _Motion, control: Control, duration: float) -> _Motion:
        """Return the motion after a control has acted for a time [s]."""
        lag, (state, a, kappa) = self.bounds.lag, motion
        if lag == 0.0:
            state = self._held(state, control, duration)
            return _Motion(state, control.acceleration, control.curvature)
        if abs(float(state[3])) < LEAST:
            a = max(a, 0.0)
        mean, left = lag_shares(lag, duration)
        off, bent = a - control.acceleration, kappa - control.curvature
        held = Control(
            control.acceleration + off * mean, control.curvature + bent * mean, control.gear
        )
        return _Motion(
            self._held(state, held, duration),
            control.acceleration + off * left,
            control.curvature + bent * left,
        )

    def _held(
        self, state: NDArray[np.float64], control: Control, duration: float
    ) -> NDArray[np.float64]:
        """Return the state after a control was held for a time [s]."""
        wanted = np.array([[control.acceleration, control.curvature]])
        driven = state if control.gear > 0 else mirrored(state)
        driven = np.array([*driven[:3], max(driven[3], 0.0)])
        after = rollout(driven, wanted, duration, self.car.driving)[0][1]
        return np.asarray(after if control.gear > 0 else mirrored(after))
