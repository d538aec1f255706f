"""A calibration: the level λ of the last resort that is certified for a risk δ of a collision.

`benchmarks.calibrate` measures it on drives and writes calibration.json, which this module reads.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from foresee.infra.errors import LineError, one_line
from foresee.infra.plain_json import read_json
from planner.revision import FIRST
from planner.risk.betting import capital, needed

KIND = "calibration"
MOST_BYTES = 10_000_000
"""Largest calibration that is read [bytes]."""
MOST_DRIVES = 10**6
"""Largest number of drives of a test, as of `foresee calibrate`; more cannot be true."""
ROUNDING = 1e-6
"""Share by which the capital in a file may exceed the largest one possible."""


class CalibrationError(LineError):
    """A calibration cannot be read, or does not hold for these drives; the message is one line."""


@dataclass(frozen=True)
class Calibration:
    """The certified levels, and the conditions under which they hold.

    Attributes:
        path: path of the file.
        conditions: settings of the drives that the levels hold for, by name: predictor, car,
            buildings and all others.
        levels: risk δ (probability of a collision in a drive) → largest level λ certified for it.
        confidence: probability with which each certificate holds.
        seed: seed of the first building of the calibration.
        drives: largest number of drives that was allowed at a level, each in a building of its own.
        revision: revision of the driving that it was measured with, see `planner.revision`.
    """

    path: Path
    conditions: dict[str, Any]
    levels: dict[float, float]
    confidence: float
    seed: int
    drives: int
    revision: int = FIRST

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read calibration.json of `benchmarks.calibrate`.

        What is certified must follow from the tests in the file.

        Raises:
            CalibrationError: if it cannot be read, or certifies what its tests do not.
        """
        try:
            content = read_json(path, MOST_BYTES)
            if content["kind"] != KIND:
                raise ValueError(f"it holds {content['kind']!r}")
            levels = {float(risk): float(level) for risk, level in content["certified"].items()}
            tests = [_Test.read(entry) for entry in content["levels"]]
            confidence, seed = float(content["confidence"]), int(content["seed"])
            _check(levels, tests, confidence)
            # Older files do not say how many buildings there were, with those without a task.
            counted = max((test.drives for test in tests), default=0)
            drives = int(content.get("most_drives", counted))
            conditions = dict(content["conditions"])
            conditions["world"] = [str(place) for place in conditions["world"]]
            revision = int(content.get("revision", FIRST))
            return cls(path, conditions, levels, confidence, seed, drives, revision)
        except (OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
            raise CalibrationError(f"{path} is no calibration: {one_line(error)}") from None

    def has_used(self, seed: int, count: int) -> bool:
        """Return whether the calibration used any of `count` buildings with seeds from `seed`."""
        return self.seed < seed + count and seed < self.seed + self.drives

    def level_at(self, risk: float) -> float:
        """Return the largest level λ that is certified for a risk, whatever the conditions.

        Args:
            risk: accepted probability δ of a collision in a drive, above 0.

        Raises:
            CalibrationError: if the certificate is only for larger risks.
        """
        allowed = [certified for certified in self.levels if certified <= risk]
        if not allowed:
            raise CalibrationError(
                f"{self.path} certifies no risk as small as {risk:g}; "
                f"it certifies {', '.join(f'{other:g}' for other in sorted(self.levels)) or 'none'}"
            )
        return self.levels[max(allowed)]

    def refuse_other(self, conditions: Mapping[str, Any]) -> None:
        """Refuse drives under other conditions than those of the certificate.

        Args:
            conditions: settings of the drives to come, by name.

        Raises:
            CalibrationError: if a condition differs; the message names it.
        """
        for name in self.differing(conditions)[:1]:
            certified, asked = self.conditions.get(name), conditions.get(name)
            raise CalibrationError(
                f"{self.path} is for {name} {_listed(certified)}, not {_listed(asked)}: "
                "calibrate anew with benchmarks.calibrate"
            )

    def differing(self, conditions: Mapping[str, Any]) -> list[str]:
        """Return the names of the conditions in which drives differ from those of the certificate.

        Args:
            conditions: settings of the drives to come, by name; `world` may be in any order.
        """

        def plain(given: Mapping[str, Any], name: str) -> Any:
            return sorted(given.get(name) or ()) if name == "world" else given.get(name)

        names = self.conditions.keys() | conditions.keys()
        # The hash of the planner's settings last, since a message about it is the least helpful.
        ordered = sorted(names, key=lambda name: (name == "planner", name))
        return [name for name in ordered if plain(self.conditions, name) != plain(conditions, name)]


@dataclass(frozen=True)
class _Test:
    """The tests of all risks at one level.

    Attributes:
        level: level λ of the last resort.
        drives: number of drives.
        collided: number of them that collided.
        capital: risk δ → largest capital of the gambler, see `planner.risk.betting`.
    """

    level: float
    drives: int
    collided: int
    capital: dict[float, float]

    @classmethod
    def read(cls, entry: Mapping[str, Any]) -> Self:
        capital = {float(risk): float(most) for risk, most in entry["capital"].items()}
        return cls(float(entry["level"]), int(entry["drives"]), int(entry["collided"]), capital)


def _check(levels: Mapping[float, float], tests: Sequence[_Test], confidence: float) -> None:
    """Check that what a file certifies follows from its tests.

    Raises:
        ValueError: if it does not, or a number lies outside of its range.
    """
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"a confidence of {confidence:g}")
    for test in tests:
        if not (0.0 <= test.level < 1.0 and 0 <= test.collided <= test.drives <= MOST_DRIVES):
            raise ValueError(f"a test at level {test.level:g}: {test.collided} of {test.drives}")
    for risk, level in levels.items():
        if not 0.0 < risk < 1.0:
            raise ValueError(f"it certifies a risk of {risk:g}")
        passed = [test for test in tests if test.level <= level]
        if level not in [test.level for test in passed]:
            raise ValueError(f"it has no test at level {level:g}, certified for {risk:g}")
        # All levels up to the certified one must have passed, since they are tested in order.
        for test in passed:
            # The capital is largest if the collisions came last.
            most = capital(np.zeros(test.drives - test.collided), risk)
            given = test.capital.get(risk, 0.0)
            if not needed(confidence) <= given <= (1.0 + ROUNDING) * most.max(initial=1.0):
                raise ValueError(
                    f"its test at level {test.level:g} does not certify a risk of {risk:g}"
                )


def _listed(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
