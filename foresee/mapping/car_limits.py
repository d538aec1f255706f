"""The car's dynamic limits and its body, for the planner and the simulator."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple, Self

from foresee.mapping.body import Body
from foresee.mapping.car_file import CarFile
from foresee.mapping.conventions import LONGEST_STOP, TIGHTEST
from foresee.mapping.finite import check_finite

CONTACT_MARGIN = 0.015
"""Margin by which the planner grows the body in collision tests [m], at every resolution."""
JUDGE_MARGIN = 0.001
"""Margin by which the simulator, which judges the planner, grows the body [m].

Both test poses that lie apart, and the margin covers what the body sweeps between them. The
planner's margin covers the simulator's as well, so that what the planner calls free never counts as
a collision."""


class DrivingLimits(NamedTuple):
    """The limits of a motion, as kernels read them.

    Attributes:
        v_max: top speed [m/s].
        acceleration: maximum acceleration [m/s²].
        braking: maximum deceleration, positive [m/s²].
        cornering: maximum lateral acceleration v²·κ [m/s²].
        curvature: maximum curvature κ [1/m].
    """

    v_max: float
    acceleration: float
    braking: float
    cornering: float
    curvature: float


@dataclass(frozen=True)
class CarLimits:
    """A car's limits and its body; the defaults are those of a fast indoor robot.

    Attributes:
        v_max: top speed [m/s].
        acceleration: maximum acceleration [m/s²].
        braking: maximum deceleration, positive [m/s²].
        lateral_acceleration: maximum lateral acceleration v²·κ [m/s²].
        turning_radius: radius of the tightest arc [m].
        body: rectangle around (x, y).
        reverse: top speed in reverse [m/s]; 0: the car has no reverse gear.
        turn_rate: yaw rate at which the car turns on the spot [rad/s]; 0: it cannot.

    Raises:
        ValueError: if a limit is not finite, or not positive; the last two may be 0; if a stop from
            top speed takes more than `LONGEST_STOP`; if the car turns on a radius below a quarter
            of the body's half diagonal.
    """

    v_max: float = 4.0
    acceleration: float = 1.5
    braking: float = 1.5
    lateral_acceleration: float = 3.0
    turning_radius: float = 0.8
    body: Body = field(default_factory=Body)
    reverse: float = 0.0
    turn_rate: float = 0.0

    def __post_init__(self) -> None:
        check_finite(
            self, "v_max", "acceleration", "braking", "lateral_acceleration", "turning_radius"
        )
        check_finite(self, "reverse", "turn_rate", zero=True)
        if self.stopping_distance > LONGEST_STOP:
            raise ValueError(
                f"braking is {self.braking} m/s²: a stop from {self.v_max} m/s takes "
                f"{self.stopping_distance:.0f} m, at most {LONGEST_STOP:g} m are planned"
            )
        if self.body.radius > TIGHTEST * self.turning_radius:
            raise ValueError(
                f"turning_radius is {self.turning_radius} m, it must be at least "
                f"{self.body.radius / TIGHTEST:g} m for this body"
            )

    @classmethod
    def read(cls, name: str) -> Self:
        """Return the car of a YAML file, or a preset; see `foresee.mapping.car_file`.

        Args:
            name: path of the file, or name of the preset.

        Raises:
            CarFileError: if it is neither, or the file breaks a rule of the format.
        """
        car = CarFile.read(name)
        return cls(
            v_max=car.v_max,
            acceleration=car.acceleration,
            braking=car.braking,
            lateral_acceleration=car.lateral_acceleration,
            turning_radius=car.turning_radius,
            body=Body(car.length, car.width),
            reverse=car.reverse,
            turn_rate=car.turn_rate,
        )

    @property
    def planned_cornering(self) -> float:
        """Lateral acceleration that plans may use [m/s²].

        A little below the limit, so that rounding does not lead beyond it.
        """
        return 0.99 * self.lateral_acceleration

    @property
    def driving(self) -> DrivingLimits:
        """The limits that plans keep to."""
        return DrivingLimits(
            self.v_max,
            self.acceleration,
            self.braking,
            self.planned_cornering,
            self.max_curvature,
        )

    @property
    def max_curvature(self) -> float:
        """Curvature of the tightest arc [1/m]."""
        return 1.0 / self.turning_radius

    def spacing(self, margin: float) -> float:
        """Return how far apart poses may be tested so that a margin covers the motion between them.

        While the car moves by s, a corner of the body moves by at most (1 + κ·r) s, with the
        tightest curvature κ and the body's half diagonal r. Half of that is the farthest that any
        point is from its place at the nearer of two tested poses.

        Args:
            margin: margin by which the body is grown [m].

        Returns:
            Distance along the path [m].
        """
        return 2.0 * margin / (1.0 + self.max_curvature * self.body.radius)

    @property
    def stopping_distance(self) -> float:
        """Distance that braking from top speed takes [m]."""
        return self.v_max**2 / (2 * self.braking)
