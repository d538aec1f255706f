"""The predictors that are compared, and what each of them answers about a square."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol, TypeGuard

import numpy as np
from numpy.typing import NDArray

from benchmarks.prediction.square import ScoredSquare
from benchmarks.recording.paper_drives import SimulatedConfig
from predictor.data.frames import checksum
from predictor.data.squares import TERNARY, codes_of
from predictor.fused import Fused
from predictor.image_predictor import ImagePredictor
from predictor.networks.image_config import PRESETS
from predictor.prediction import BadPredictionError, Predictor, asked
from predictor.provenance import fingerprint_of
from predictor.registry import FUSED, SUFFIX, PredictorError, load_predictor
from predictor.scoring.images import ternary

BASELINES = ("copy", "grey")
"""The input as it is, unknown around; and an image that is grey all over. Always compared."""


@dataclass(frozen=True)
class Contestant:
    """A predictor that is compared, or one of `BASELINES`.

    Attributes:
        name: in the tables.
        spec: as `predictor.load_predictor` takes it.
        expansion: the only one that it can do; None: any.
        identity: of its weights and what runs them, or of its source: whose scores may be kept.
    """

    name: str
    spec: str
    expansion: float | None
    identity: str

    def does(self, expansion: float) -> bool:
        """Whether it can predict a square this much wider."""
        return self.expansion is None or abs(self.expansion - expansion) < 1e-6


def contestants(wanted: Sequence[str], expansions: Sequence[float]) -> list[Contestant]:
    """All that are compared: the baselines, then those wanted, in their order.

    Args:
        wanted: each what `predictor.load_predictor` takes, or a folder of `predictor.study`; NAME=
            before it renames it, and stands before all of a folder.
        expansions: of the squares.

    Raises:
        PredictorError: if one cannot be made, does none of these expansions, or two of one name do
            the same one.
    """
    found = [Contestant(name, name, None, name) for name in BASELINES]
    for entry in wanted:
        label, _, spec = entry.rpartition("=")
        if Path(spec).is_dir():
            found += _of_study(Path(spec), label, expansions)
        elif spec not in BASELINES:
            found.append(_of_spec(spec, label, expansions))
    taken: dict[tuple[str, float], str] = {}
    for one in found:
        for expansion in filter(one.does, expansions):
            other = taken.setdefault((one.name, expansion), one.spec)
            if other != one.spec:
                raise PredictorError(f"{other} and {one.spec} are both called {one.name}: give one "
                                     "another name, NAME=PREDICTOR")  # fmt: skip
    return list(dict.fromkeys(found))


def reduced(facts: dict[str, Any]) -> dict[str, Any] | None:
    """In what a training differs from the paper's, with the values that it has; None: in nothing.

    Args:
        facts: of an image network's weights.
    """
    paper = PRESETS["paper"]
    printed = asdict(paper.training) | {
        "width": paper.width, "side": paper.side, "given": "crop", "turned": False,
        "frames": SimulatedConfig().train,
    }  # fmt: skip
    theirs = facts.get("config", {}) | facts.get("network", {}) | {"frames": facts.get("frames")}
    other = {name: theirs.get(name) for name, value in printed.items()
             if name != "seed" and theirs.get(name) != value}  # fmt: skip
    return other or None


def _of_study(folder: Path, label: str, expansions: Sequence[float]) -> list[Contestant]:
    """The networks of a study that are trained, at these expansions."""
    files = sorted(folder.glob(f"*/*{SUFFIX}"))
    if not files:
        raise PredictorError(f"{folder} holds no trained networks, NAME/ARCH{SUFFIX}: "
                             "python -m predictor.study makes them")  # fmt: skip
    found = []
    for path in files:
        expansion = _expansion_of(load_predictor(str(path)))
        if expansion is None or any(abs(expansion - one) < 1e-6 for one in expansions):
            name = f"{label}/{path.stem}" if label else path.stem
            found.append(_of_spec(str(path), name, expansions))
    if not found:
        raise PredictorError(f"{folder} holds no network for any of these expansions: "
                             + ", ".join(f"{one:g}" for one in expansions))  # fmt: skip
    return found


def _of_spec(spec: str, label: str, expansions: Sequence[float]) -> Contestant:
    predictor = load_predictor(spec)
    expansion = _expansion_of(predictor)
    name = label or _short(spec)
    one = Contestant(name, spec, expansion, _identity(spec, predictor))
    if name in BASELINES:
        raise PredictorError(f"{spec} cannot be called {name}, for a baseline is")
    if not any(map(one.does, expansions)):
        raise PredictorError(f"{spec} holds weights for an expansion of {expansion:g}: add it to "
                             "--expansions")  # fmt: skip
    return one


def _short(spec: str) -> str:
    """What a predictor is called that nobody has named."""
    if spec.startswith(FUSED):
        return f"fused_{Path(spec).name}"
    return Path(spec).stem if spec.endswith(SUFFIX) else spec


def _expansion_of(predictor: Any) -> float | None:
    """The only expansion that a predictor can do; None: any."""
    return predictor.config.expansion if isinstance(predictor, ImagePredictor) else None


def _identity(spec: str, predictor: Any) -> str:
    """What a predictor's scores hang on, as far as it can be told."""
    print_ = fingerprint_of(predictor)
    if print_ is not None:
        return print_
    try:
        # One file may hold several.
        return f"{spec} {checksum(Path(inspect.getfile(type(predictor))))}"
    except (TypeError, OSError):
        # Made of compiled code, or at a prompt.
        return f"{spec} {type(predictor).__qualname__}"


@dataclass(frozen=True, eq=False)
class Answer:
    """What is said of a square, (n, n) each.

    Attributes:
        image: greys in [0, 1]: free 1, not known 0.5, occupied 0.
        kept: the same, in which what the predictor was given is as it was given.
        p_free: probability of free; only cells not seen count.
        p_occupied: likewise.
        nan_cells: how many were NaN, which count as not known.
    """

    image: NDArray[np.float64]
    kept: NDArray[np.float64]
    p_free: NDArray[np.float32]
    p_occupied: NDArray[np.float32]
    nan_cells: int = 0


class Entrant(Protocol):
    """A contestant that is ready."""

    def answer(self, square: ScoredSquare) -> Answer:
        """What it says.

        Raises:
            BadPredictionError: if it breaks the contract of predictors.
        """
        ...


def entrant(contestant: Contestant, rates: tuple[float, float]) -> Entrant:
    """Make a contestant ready.

    Args:
        contestant: who.
        rates: shares of free and of occupied among cells not seen, which is what the baselines
            say of these.
    """
    if contestant.name in BASELINES:
        return _Baseline(contestant.name == "copy", rates)
    predictor = _loaded(contestant.spec)
    if is_printed(predictor):
        return _Printed(predictor)
    return _Believed(predictor)


def is_printed(predictor: Any) -> TypeGuard[ImagePredictor | Fused]:
    """Whether a predictor is made of networks that print a grey image."""
    return isinstance(predictor, ImagePredictor | Fused)


def prints(contestant: Contestant) -> bool:
    """Whether a contestant is such a predictor."""
    return contestant.name not in BASELINES and is_printed(_loaded(contestant.spec))


@dataclass(frozen=True)
class _Baseline:
    """The crop as it is, or nothing.

    Its one grey of cells not seen means what such cells are on the validation drives.
    """

    copies: bool
    rates: tuple[float, float]

    def answer(self, square: ScoredSquare) -> Answer:
        crop = TERNARY[codes_of(square.crop.cells)]
        image = crop if self.copies else np.full_like(crop, 0.5)
        free, occupied = (np.full(crop.shape, rate, np.float32) for rate in self.rates)
        return Answer(image, image, free, occupied)


@dataclass(frozen=True)
class _Printed:
    """A network of the paper: its raw image is scored, and what its greys mean."""

    predictor: ImagePredictor | Fused

    def answer(self, square: ScoredSquare) -> Answer:
        known = square.crop if self.predictor.given == "crop" else square.window
        grey, p_free, p_occupied, _ = self.predictor.printed(known, square.pose)
        if not np.isfinite(grey).all():
            raise BadPredictionError("the network printed numbers that are not finite")
        image = 0.5 + 0.5 * grey.astype(np.float64)
        kept = np.where(known.unknown, image, TERNARY[codes_of(known.cells)])
        return Answer(image, kept, p_free, p_occupied)


@dataclass(frozen=True)
class _Believed:
    """Any predictor, given what a planner would give it."""

    predictor: Predictor

    def answer(self, square: ScoredSquare) -> Answer:
        belief = asked(self.predictor, square.window, square.pose)
        image = ternary(square.window, belief)
        return Answer(image, image, belief.p_free, belief.p_occupied, belief.nan_cells)


@lru_cache(maxsize=8)
def _loaded(spec: str) -> Predictor:
    return load_predictor(spec)
