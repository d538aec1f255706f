"""Cars as YAML files: body and limits of a platform.

docs/reference/cars.md describes the format. This module is light, so that command lines can read a
car before they import what computes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from reprlib import repr as short
from typing import Any, Self

from foresee.infra.errors import LineError, one_line
from foresee.infra.plain_json import fits
from foresee.infra.plain_yaml import YamlError, read_yaml
from foresee.mapping.conventions import LONGEST_STOP, TIGHTEST

FOLDER = Path(__file__).with_name("cars")
PRESETS = tuple(sorted(path.stem for path in FOLDER.glob("*.yaml")))
"""Names of the cars that the package contains."""
MOST_BYTES = 20_000
"""Largest file that is read [bytes]."""
REQUIRED = {
    "length_m": (0.1, 5.0),
    "width_m": (0.05, 3.0),
    "top_speed_m_s": (0.5, 10.0),
    "acceleration_m_s2": (0.1, 10.0),
    "braking_m_s2": (0.3, 10.0),
    "lateral_acceleration_m_s2": (0.1, 20.0),
}
"""Required key → smallest and largest value."""
TURNING = {"turning_radius_m": (0.05, 20.0)}
"""The same of the key of a car whose turning radius is known."""
STEERING = {"wheelbase_m": (0.05, 5.0), "steering_limit_rad": (0.05, 1.3)}
"""The same of the keys from which the turning radius of a car with front steering follows."""
OPTIONAL = {
    "reverse_speed_m_s": (0.0, 10.0),
    "rear_overhang_m": (0.0, 5.0),
    "turn_rate_rad_s": (0.0, 10.0),
}
RANGES = REQUIRED | TURNING | STEERING | OPTIONAL


class CarFileError(LineError):
    """A file describes no car that can be driven; the message is one line that says why."""


@dataclass(frozen=True)
class CarFile:
    """A car as a file describes it.

    Attributes:
        length: extent of the body along the heading [m]; its centre is (x, y).
        width: extent across it [m].
        turning_radius: radius of the tightest arc of (x, y) [m].
        v_max: top speed [m/s].
        acceleration: maximum acceleration [m/s²].
        braking: maximum deceleration, positive [m/s²].
        lateral_acceleration: maximum lateral acceleration [m/s²].
        reverse: top speed in reverse [m/s]; 0: no reverse gear.
        turn_rate: yaw rate at which it turns on the spot [rad/s]; 0: it cannot.
    """

    length: float
    width: float
    turning_radius: float
    v_max: float
    acceleration: float
    braking: float
    lateral_acceleration: float
    reverse: float
    turn_rate: float

    @classmethod
    def read(cls, name: str) -> Self:
        """Read a car.

        Args:
            name: path of a YAML file, or one of `PRESETS`.

        Raises:
            CarFileError: if it is neither, or breaks a rule of the format.
        """
        path = FOLDER / f"{name}.yaml" if name in PRESETS else Path(name)
        if path.suffix not in (".yaml", ".yml"):
            raise CarFileError(
                f"{name!r} is no car: give a .yaml file or one of {', '.join(PRESETS)}"
            )
        try:
            return cls._of(_checked(read_yaml(path, MOST_BYTES)))
        except CarFileError as error:
            raise CarFileError(f"{path}: {error}") from None
        except (OSError, YamlError) as error:
            raise CarFileError(f"{path} is no file of a car: {one_line(error)}") from None

    @classmethod
    def _of(cls, values: Mapping[str, float]) -> Self:
        length = values["length_m"]
        if "rear_overhang_m" in values:
            # (x, y) is the rear axle. The body reaches as far behind it as ahead of it, so that the
            # real body lies within.
            length = 2.0 * max(values["rear_overhang_m"], length - values["rear_overhang_m"])
        return cls(
            length=length,
            width=values["width_m"],
            turning_radius=_turning_radius(values),
            v_max=values["top_speed_m_s"],
            acceleration=values["acceleration_m_s2"],
            braking=values["braking_m_s2"],
            lateral_acceleration=values["lateral_acceleration_m_s2"],
            reverse=values.get("reverse_speed_m_s", 0.0),
            turn_rate=values.get("turn_rate_rad_s", 0.0),
        )

    def __post_init__(self) -> None:
        stop = self.v_max**2 / (2.0 * self.braking)
        if stop > LONGEST_STOP:
            raise CarFileError(
                f"braking of {self.braking:g} m/s²: a stop from {self.v_max:g} m/s, the top speed, "
                f"takes {stop:.0f} m, it must take at most {LONGEST_STOP:g} m"
            )
        least = math.hypot(self.length, self.width) / 2.0 / TIGHTEST
        if self.turning_radius < least:
            raise CarFileError(
                f"a turning radius of {self.turning_radius:g} m, it must be at least {least:.3g} m "
                "for this body"
            )


def _turning_radius(values: Mapping[str, float]) -> float:
    """Return the radius of the tightest arc of (x, y) [m]."""
    if "turning_radius_m" in values:
        return values["turning_radius_m"]
    wheelbase = values["wheelbase_m"]
    rear = wheelbase / math.tan(values["steering_limit_rad"])
    # Without the place of the rear axle, the centre of the body is halfway between the axles.
    return rear if "rear_overhang_m" in values else math.hypot(rear, wheelbase / 2.0)


def _checked(content: Any) -> dict[str, float]:
    """Return the values of a file, whose keys and numbers are as they must be."""
    if not isinstance(content, dict):
        raise CarFileError(f"it holds {short(content)}, it must hold keys with numbers")
    for key, value in content.items():
        if key not in RANGES:
            raise CarFileError(f"{short(key)} is no key of a car; there are {', '.join(RANGES)}")
        low, high = RANGES[key]
        if not fits(value, float) or not low <= value <= high:
            raise CarFileError(
                f"{key} is {short(value)}, it must be a number from {low:g} to {high:g}"
            )
    missing = [key for key in REQUIRED if key not in content]
    if missing:
        raise CarFileError(f"it has no {missing[0]}, a number from {REQUIRED[missing[0]][0]:g} on")
    ways = [[key for key in way if key in content] for way in (TURNING, STEERING)]
    if (len(ways[0]), len(ways[1])) not in ((1, 0), (0, len(STEERING))):
        given = ", ".join(ways[0] + ways[1]) or "neither"
        raise CarFileError(
            f"it has {given}; it must have turning_radius_m, or {' and '.join(STEERING)}"
        )
    if content.get("rear_overhang_m", 0.0) > content["length_m"]:
        raise CarFileError(
            f"rear_overhang_m is {content['rear_overhang_m']:g}, it must be at most the length, "
            f"{content['length_m']:g}"
        )
    if content.get("turn_rate_rad_s") and not content.get("reverse_speed_m_s"):
        raise CarFileError(
            "it has turn_rate_rad_s, so it must have reverse_speed_m_s: a robot that turns on the "
            "spot drives some wheels backwards"
        )
    if content.get("turn_rate_rad_s") and "wheelbase_m" in content:
        raise CarFileError("a car with front steering cannot turn on the spot: give only one")
    return {key: float(value) for key, value in content.items()}
