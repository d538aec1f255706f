"""The report of a tick: what the node does, and why it is slow."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from foresee.mapping.conventions import TICK
from foresee_navigator.forecast import Forecast
from foresee_navigator.pilot import Action, Mode


class Severity(IntEnum):
    """How bad it is, as in diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True)
class Report:
    """A report, for diagnostic_msgs/DiagnosticStatus.

    Attributes:
        severity: how bad it is.
        message: a line for people.
        values: facts for programs, by name.
    """

    severity: Severity
    message: str
    values: dict[str, str]


@dataclass(frozen=True)
class Circumstances:
    """What a report says besides the action.

    Attributes:
        complaints: lines about inputs that are missing or late.
        duration: duration of the tick [s].
        fresh_starts: number of times that the map began anew.
        last_fresh_start: why it last did; empty if it never did.
    """

    complaints: tuple[str, ...] = ()
    duration: float = 0.0
    fresh_starts: int = 0
    last_fresh_start: str = ""

    @property
    def is_late(self) -> bool:
        """Whether the tick took longer than a control period."""
        return self.duration > TICK

    @property
    def values(self) -> dict[str, str]:
        """The facts, by name."""
        return {
            "missing": "; ".join(self.complaints),
            "late": _yes(self.is_late),
            "duration_ms": f"{1e3 * self.duration:.0f}",
            "fresh_starts": str(self.fresh_starts),
            "last_fresh_start": self.last_fresh_start,
        }


def report_on(action: Action, around: Circumstances) -> Report:
    """Return the report of a tick in which the node drives."""
    values = {
        "mode": str(action.mode),
        "speed": f"{action.speed:.2f}",
        "yaw_rate": f"{action.yaw_rate:.2f}",
        "limit": "",
        "faults": "bad_scan" if action.bad_scan else "",
        "emergency": _yes(False),
    }
    decision = action.decision
    if decision is not None:
        values |= {
            "limit": str(decision.limit),
            "faults": ", ".join(decision.faults),
            "emergency": _yes(decision.emergency),
        }
        taken = {name: decision.times.get(name) for name in ("cycle", "path")}
        values |= {f"{name}_ms": f"{ms:.0f}" for name, ms in taken.items() if ms is not None}
    message = str(action.mode)
    if action.mode is Mode.STOPPED:
        why = "; ".join(around.complaints) or "it rolled when the map began"
        message = f"stops: {why}"
    elif decision is not None:
        message = f"{action.mode}, limited by {decision.limit}"
    emergency = decision is not None and decision.emergency
    error = action.mode is Mode.STOPPED or emergency
    return _graded(error, message, values, around)


def report_on_forecast(forecast: Forecast | None, around: Circumstances) -> Report:
    """Return the report of a tick in which another planner drives; None: inputs are missing."""
    if forecast is None:
        message = f"no forecast: {'; '.join(around.complaints)}"
        return _graded(True, message, {"mode": "predicts", "speed_limit": "0.00"}, around)
    values = {
        "mode": "predicts",
        "speed_limit": f"{forecast.speed_limit:.2f}",
        "faults": ", ".join(forecast.faults),
    }
    message = f"predicts, speed limit {forecast.speed_limit:.2f} m/s"
    return _graded(False, message, values, around)


def _graded(error: bool, message: str, values: dict[str, str], around: Circumstances) -> Report:
    warned = bool(values.get("faults")) or around.is_late
    severity = Severity.ERROR if error else Severity.WARN if warned else Severity.OK
    if values.get("faults"):
        message += f"; {values['faults']}"
    if around.is_late:
        message += f"; late, {1e3 * around.duration:.0f} ms"
    return Report(severity, message, values | around.values)


def _yes(value: bool) -> str:
    return "yes" if value else "no"
