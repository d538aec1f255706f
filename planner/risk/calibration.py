"""A calibration: the level λ of the last resort that is certified for a risk δ of a collision.

`benchmarks.calibrate` measures it on drives and writes calibration.json, which this module reads.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from foresee.infra.errors import LineError, one_line
from foresee.infra.plain_json import loads

KIND = "calibration"


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
    """

    path: Path
    conditions: dict[str, Any]
    levels: dict[float, float]
    confidence: float
    seed: int
    drives: int

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read calibration.json of `benchmarks.calibrate`.

        Raises:
            CalibrationError: if it cannot be read.
        """
        try:
            found = loads(path.read_text())
            if found["kind"] != KIND:
                raise ValueError(f"it holds {found['kind']!r}")
            levels = {float(risk): float(level) for risk, level in found["certified"].items()}
            counted = max((int(entry["drives"]) for entry in found["levels"]), default=0)
            # Older files do not say how many buildings there were, with those without a task.
            drives = int(found.get("most_drives", counted))
            conditions, confidence = dict(found["conditions"]), float(found["confidence"])
            conditions["world"] = [str(place) for place in conditions["world"]]
            return cls(path, conditions, levels, confidence, int(found["seed"]), drives)
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise CalibrationError(f"{path} is no calibration: {one_line(error)}") from None

    def has_used(self, seed: int, count: int) -> bool:
        """Return whether the calibration used any of `count` buildings with seeds from `seed`."""
        return self.seed < seed + count and seed < self.seed + self.drives

    def level_for(self, risk: float, conditions: Mapping[str, Any]) -> float:
        """Return the largest level λ of the last resort that is certified for a risk.

        Args:
            risk: accepted probability δ of a collision in a drive, above 0.
            conditions: settings of the drives to come; `world` may be in any order, but must name
                the same buildings, since the certificate is for their mixture.

        Raises:
            CalibrationError: if the certificate is for other conditions, or only for larger risks.
        """
        self.refuse_other(conditions)
        allowed = [certified for certified in self.levels if certified <= risk]
        if not allowed:
            raise CalibrationError(
                f"{self.path} certifies no risk as small as {risk:g}; "
                f"it certifies {', '.join(f'{one:g}' for one in sorted(self.levels)) or 'none'}"
            )
        return self.levels[max(allowed)]

    def refuse_other(self, conditions: Mapping[str, Any]) -> None:
        """Refuse drives under other conditions than those of the certificate.

        Args:
            conditions: settings of the drives to come, by name.

        Raises:
            CalibrationError: if a condition differs; the message names it.
        """
        names = self.conditions.keys() | conditions.keys()
        # The hash of the planner's settings last, since a message about it is the least helpful.
        for name in sorted(names, key=lambda name: (name == "planner", name)):
            theirs, mine = self.conditions.get(name), conditions.get(name)
            if name == "world":
                theirs, mine = sorted(theirs or ()), sorted(mine or ())
            if mine != theirs:
                raise CalibrationError(
                    f"{self.path} is for {name} {_told(theirs)}, not {_told(mine)}: calibrate anew "
                    "with benchmarks.calibrate"
                )


def _told(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
