"""A calibration: how far the last resort may rely upon predictions, for a chance of collision.

`benchmarks.calibrate` measures it on drives, and writes the file that this module reads.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from predictor.infra.errors import LineError, one_line
from predictor.infra.plain_json import loads

KIND = "calibration"


class CalibrationError(LineError):
    """A calibration cannot be read, or does not allow what is asked of it; one line."""


@dataclass(frozen=True)
class Calibration:
    """The levels that were certified, and for what.

    Attributes:
        path: of the file.
        conditions: all that the certificate holds for, by name: predictor, car, buildings, and all
            other settings of the drives.
        levels: chance of a collision δ in a drive → the largest level λ certified for it.
        confidence: the probability with which each certificate holds.
        seed: of the first building that it was made in.
        drives: the most drives at a level; each was in a building of its own.
    """

    path: Path
    conditions: dict[str, Any]
    levels: dict[float, float]
    confidence: float
    seed: int
    drives: int

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a file of `benchmarks.calibrate`.

        Raises:
            CalibrationError: if it cannot be read.
        """
        try:
            found = loads(path.read_text())
            if found["kind"] != KIND:
                raise ValueError(f"it holds {found['kind']!r}")
            levels = {float(risk): float(level) for risk, level in found["certified"].items()}
            drives = max((int(entry["drives"]) for entry in found["levels"]), default=0)
            conditions, confidence = dict(found["conditions"]), float(found["confidence"])
            conditions["world"] = [str(place) for place in conditions["world"]]
            return cls(path, conditions, levels, confidence, int(found["seed"]), drives)
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise CalibrationError(f"{path} is no calibration: {one_line(error)}") from None

    def has_used(self, seed: int, count: int) -> bool:
        """Return whether it was made in one of `count` buildings with seeds from `seed` on."""
        return self.seed < seed + count and seed < self.seed + self.drives

    def level_for(self, risk: float, conditions: Mapping[str, Any]) -> float:
        """Return the level λ of the last resort that a chance of collision allows.

        Args:
            risk: chance of a collision in a drive δ, above 0.
            conditions: of the drives to come; `world` may be in any order, but must name the same
                buildings, since the certificate is for their mixture.

        Raises:
            CalibrationError: if the certificate is for other conditions, or for no risk as small.
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
        """Raise an error that names a condition in which drives differ from the certificate.

        Raises:
            CalibrationError: if there is one.
        """
        names = self.conditions.keys() | conditions.keys()
        # The hash of the planner's settings last: what a line says of it helps nobody.
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
