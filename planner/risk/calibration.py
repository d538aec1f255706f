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
SHIPPED = Path(__file__).with_name("calibration.json")
"""The calibration that comes with this project, of the shipped predictor."""


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
    """

    path: Path
    conditions: dict[str, Any]
    levels: dict[float, float]
    confidence: float

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
            return cls(path, dict(found["conditions"]), levels, float(found["confidence"]))
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise CalibrationError(f"{path} is no calibration: {one_line(error)}") from None

    def level_for(self, risk: float, conditions: Mapping[str, Any]) -> float:
        """Return the level λ of the last resort that a chance of collision allows.

        Args:
            risk: chance of a collision in a drive δ; 0 allows the level 0 without any calibration.
            conditions: of the drives to come.

        Raises:
            CalibrationError: if the certificate is for other conditions, or for no risk as small.
        """
        for name, wanted in self.conditions.items():
            mine = conditions.get(name)
            # Of several kinds of buildings each must have been part of the drives.
            if mine != wanted and not (name == "world" and _within(mine, wanted)):
                raise CalibrationError(
                    f"{self.path} is for {name} {_told(wanted)}, not {_told(mine)}: calibrate anew "
                    "with benchmarks.calibrate"
                )
        allowed = [certified for certified in self.levels if certified <= risk]
        if not allowed:
            raise CalibrationError(
                f"{self.path} certifies no risk as small as {risk:g}; "
                f"it certifies {', '.join(f'{one:g}' for one in sorted(self.levels)) or 'none'}"
            )
        return self.levels[max(allowed)]


def _within(mine: Any, theirs: Any) -> bool:
    return isinstance(mine, list | tuple) and isinstance(theirs, list) and set(mine) <= set(theirs)


def _told(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
