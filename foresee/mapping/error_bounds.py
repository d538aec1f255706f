"""Bounds of a robot's errors: what the navigator is told, and what a simulation keeps to."""

from __future__ import annotations

from dataclasses import dataclass

from foresee.mapping.finite import check_finite


@dataclass(frozen=True)
class ErrorBounds:
    """Bounds of the errors of a robot's sensing and motion. By default there are none.

    Attributes:
        delay: time from a scan until the control that it leads to acts on the motors [s].
        jitter: time by which this may take longer, differently in each tick [s].
        lag: time constant with which acceleration and curvature follow their commands (first
            order) [s].
        position: largest distance of the estimated position from the true one [m].
        yaw: largest error of the estimated yaw [rad].
        range: largest error of a measured range [m].

    Raises:
        ValueError: if a bound is negative or not finite.
    """

    delay: float = 0.0
    jitter: float = 0.0
    lag: float = 0.0
    position: float = 0.0
    yaw: float = 0.0
    range: float = 0.0

    def __post_init__(self) -> None:
        check_finite(self, "delay", "jitter", "lag", "position", "yaw", "range", zero=True)

    @property
    def senses_exactly(self) -> bool:
        """Whether pose and ranges have no error."""
        return self.position == self.yaw == self.range == 0.0

    @property
    def moves_exactly(self) -> bool:
        """Whether controls act at a known time, and at once."""
        return self.jitter == self.lag == 0.0

    @property
    def shift(self) -> float:
        """Mean time from a scan until its control begins to act [s]."""
        return self.delay + 0.5 * self.jitter

    def apart(self, distance: float) -> float:
        """Return how far a point at a distance from the robot may be from where it seems [m]."""
        return self.position + self.yaw * distance


NO_ERRORS = ErrorBounds()
"""Exact sensing, and motion without a delay."""
