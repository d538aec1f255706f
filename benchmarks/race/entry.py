"""Entries of a race: an arm of this project, a predictor or a driver of one's own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

from benchmarks.runs.arms import ARMS, CALIBRATED_ARM
from benchmarks.runs.drive import run_fingerprint
from benchmarks.runs.settings import Settings
from foresee.infra.command_line import UsageError
from foresee.infra.plug_in import PlugInError, load_plug_in
from planner.revision import FIRST
from predictor.provenance import weights_fingerprint
from predictor.registry import is_plug_in
from predictor.source import Source


@dataclass(frozen=True)
class Entry:
    """What takes part in a race.

    Attributes:
        kind: "arm", "predictor" or "driver".
        of: name of the arm; or the predictor or driver as on the command line.
        fingerprint: of the weights, and of the source of a predictor or driver of one's own; None:
            it is a part of this project without weights.
        sources: files of one's own that the fingerprint covers, see `Source`.
        risk: accepted probability of a collision in a drive of a predictor.
        level: level λ that a calibration gives for the risk.
        uncertified: whether that calibration is for other drives.
        calibrated: revision of the driving that the calibration was measured with.
    """

    kind: str
    of: str
    fingerprint: str | None
    sources: tuple[str, ...] = ()
    risk: float = 0.0
    level: float = 0.0
    uncertified: bool = False
    calibrated: int = FIRST

    @classmethod
    def load(cls, kind: str, of: str) -> Self:
        """Return an entry, after loading what takes part.

        Raises:
            UsageError: if there is no such arm.
            PredictorError: if the predictor cannot be loaded.
            PlugInError: if the driver cannot be loaded.
        """
        if kind == "driver":
            weights, source = weights_fingerprint(load_driver(of)), Source.of(of)
            both = " and ".join(filter(None, (weights, source.digest)))
            return cls(kind, of, both, source.files)
        entry = cls(kind, of, None)
        arm = ARMS.get(entry.arm)
        if arm is None:
            raise UsageError(f"--arm: no arm is called {of!r}; there are {', '.join(ARMS)}")
        settings = Settings(arms=(entry.arm,), predictor=entry.predictor)
        fingerprint = run_fingerprint(settings) if arm.has_predictor else None
        sources = Source.of(of).files if kind == "predictor" and is_plug_in(of) else ()
        return replace(entry, fingerprint=fingerprint, sources=sources)

    @property
    def facts(self) -> dict[str, str | None]:
        """What takes part, as plain data for JSON, without the risk."""
        return {"kind": self.kind, "of": self.of, "fingerprint": self.fingerprint}

    @property
    def arm(self) -> str:
        """The arm that drives, for an entry that is no driver of its own."""
        return self.of if self.kind == "arm" else CALIBRATED_ARM

    @property
    def predictor(self) -> str:
        """The predictor that the arm drives with."""
        return self.of if self.kind == "predictor" else "compact"


def load_driver(spec: str) -> Any:
    """Return the class of a controller, or another function that makes one from a mission.

    Raises:
        PlugInError: if there is none.
    """
    make = load_plug_in(spec, "driver")
    if not callable(make):
        raise PlugInError(
            f"driver {spec!r} is of type {type(make).__name__}, it must be a class or a function "
            "that makes a driver"
        )
    return make
