"""Controls that were sent, and the state of the car when the next one will act."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.car_limits import CarLimits
from foresee.mapping.control import Control
from foresee.mapping.error_bounds import ErrorBounds
from planner.motion.dynamics import rollout
from planner.motion.plan import mirrored
from planner.safety.tube import EXACT, Tube, widened

SETTLED = 3.0
"""Time after which the response to a control counts as complete, in time constants of the lag."""


class SentControls:
    """Remembers the controls that were sent, and predicts where the next one will act.

    A control acts only after `ErrorBounds.shift`. Until then the car does what it was told before.

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

    def add(self, control: Control) -> None:
        """Add the control that was sent in this tick."""
        self._sent.append(control)

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
            The state then, and the tube of plans that begin with it.
        """
        bounds, dt = self.bounds, self.dt
        exact = bounds.senses_exactly and bounds.moves_exactly
        if exact and bounds.delay == 0.0:
            return state, EXACT
        reach = self.car.body.radius
        tube = EXACT._replace(
            half=0.5 * bounds.jitter, lag=bounds.lag, reach=reach, braking=self.car.braking
        )
        radius, yaw, slip, speed = bounds.apart(reach), bounds.yaw, 0.0, 0.0
        before, *controls = self._sent
        for number, control in enumerate(controls):
            back = len(controls) - number
            begin, end = bounds.shift - back * dt, bounds.shift - (back - 1) * dt
            change = abs(control.acceleration - before.acceleration)
            bend = abs(control.curvature - before.curvature)
            spent = end - max(begin, 0.0)
            v = abs(float(state[3]))
            length = 0.0
            if spent > 1e-9:
                state = self._after(state, control, spent)
                length = 0.5 * (v + abs(float(state[3]))) * spent
            # A control that has acted for sure has left its mark on the state already.
            acting = begin + 0.5 * bounds.jitter <= 0.0
            radius, yaw, slip, speed = widened(
                tube._replace(half=0.0) if acting else tube,
                *(radius, yaw, slip, speed, v, change, bend, length, max(spent, 0.0)),
            )
            before = control
        if exact:
            return state, EXACT
        return state, tube._replace(
            radius=radius,
            yaw=yaw,
            slip=slip,
            speed=speed,
            acceleration=before.acceleration,
            curvature=before.curvature,
        )

    def _after(
        self, state: NDArray[np.float64], control: Control, duration: float
    ) -> NDArray[np.float64]:
        """Return the state after a control has acted for a time [s]."""
        wanted = np.array([[control.acceleration, control.curvature]])
        driven = state if control.gear > 0 else mirrored(state)
        driven = np.array([*driven[:3], max(driven[3], 0.0)])
        after = rollout(driven, wanted, duration, self.car.driving)[0][1]
        return np.asarray(after if control.gear > 0 else mirrored(after))
