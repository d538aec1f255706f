"""The predictors that are compared ("contestants"), and their answers about a square."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.katyal2018.square import ScoredSquare
from foresee.mapping.grid import Grid
from foresee.prediction import BadPredictionError, Caller, Predictor, View
from predictor.data.frames import checksum
from predictor.data.squares import TERNARY, encode_cells
from predictor.fused import Fused
from predictor.image_predictor import ImagePredictor
from predictor.provenance import weights_fingerprint
from predictor.recording.settings import SimulatedConfig
from predictor.registry import FUSED, PredictorError, load_predictor
from predictor.scoring.images import ternary
from predictor.training.settings import PRESETS, ImageTraining
from predictor.weights import SUFFIX

BASELINES = ("copy", "grey")
"""Names of the baselines: the unchanged crop, unknown around it; and an image that is all grey."""


@dataclass(frozen=True)
class Contestant:
    """A predictor that is compared, or one of `BASELINES`.

    Attributes:
        name: name in the tables.
        spec: argument of `predictor.load_predictor`.
        expansion: only expansion that it can predict; None: any.
        identity: fingerprint of its weights and runtime, or of its source file; scores are stored
            under it.
    """

    name: str
    spec: str
    expansion: float | None
    identity: str

    def does(self, expansion: float) -> bool:
        """Return whether it can predict squares of an expansion."""
        return self.expansion is None or abs(self.expansion - expansion) < 1e-6


def contestants(wanted: Sequence[str], expansions: Sequence[float]) -> list[Contestant]:
    """Return the contestants: the baselines, then the wanted predictors in their order.

    Args:
        wanted: arguments of `predictor.load_predictor`, or folders of `predictor.study`; a prefix
            NAME= renames a predictor, and is put before the names of a folder.
        expansions: expansions of the squares.

    Raises:
        PredictorError: if one cannot be made or predicts none of these expansions, or two have the
            same name at the same expansion.
    """
    entries = [Contestant(name, name, None, name) for name in BASELINES]
    for entry in wanted:
        label, _, spec = entry.rpartition("=")
        if Path(spec).is_dir():
            entries += _of_study(Path(spec), label, expansions)
        elif spec not in BASELINES:
            entries.append(_of_spec(spec, label, expansions))
    taken: dict[tuple[str, float], str] = {}
    for contestant in entries:
        for expansion in filter(contestant.does, expansions):
            other = taken.setdefault((contestant.name, expansion), contestant.spec)
            if other != contestant.spec:
                raise PredictorError(
                    f"{other} and {contestant.spec} are both called {contestant.name}: give one "
                    "another name, NAME=PREDICTOR"
                )
    return list(dict.fromkeys(entries))


def reduced(facts: dict[str, Any]) -> dict[str, Any] | None:
    """Return the settings in which a training differs from the paper's; None if there are none.

    Args:
        facts: facts of the weights of a network of the paper.
    """
    paper = PRESETS["paper"]
    published = asdict(paper.training) | {
        "width": paper.width,
        "side": paper.side,
        "given": "crop",
        "turned": False,
        "frames": SimulatedConfig().train,
    }
    # Older weights do not record all settings; those that are missing had their defaults.
    actual = asdict(ImageTraining()) | facts.get("config", {}) | facts.get("network", {})
    actual |= {"frames": facts.get("frames")}
    other = {
        name: actual.get(name)
        for name, value in published.items()
        if name != "seed" and actual.get(name) != value
    }
    return other or None


def _of_study(folder: Path, label: str, expansions: Sequence[float]) -> list[Contestant]:
    """Return the trained networks of a study at these expansions."""
    files = sorted(folder.glob(f"*/*{SUFFIX}"))
    if not files:
        raise PredictorError(
            f"{folder} holds no trained networks, NAME/ARCH{SUFFIX}: "
            "python -m predictor.study makes them"
        )
    prefix = f"{label}/" if label else ""
    networks = [_contestant(str(path), prefix + path.stem) for path in files]
    able = [network for network in networks if any(map(network.does, expansions))]
    if not able:
        raise PredictorError(
            f"{folder} holds no network for any of these expansions: "
            + ", ".join(f"{expansion:g}" for expansion in expansions)
        )
    return able


def _of_spec(spec: str, label: str, expansions: Sequence[float]) -> Contestant:
    """Return a predictor that is named by itself."""
    short = f"fused_{Path(spec).name}" if spec.startswith(FUSED) else spec
    contestant = _contestant(spec, label or (Path(spec).stem if spec.endswith(SUFFIX) else short))
    if contestant.name in BASELINES:
        raise PredictorError(f"{spec} cannot be called {contestant.name}: a baseline has this name")
    if not any(map(contestant.does, expansions)):
        raise PredictorError(
            f"{spec} holds weights for an expansion of {contestant.expansion:g}: add it to "
            "--expansions"
        )
    return contestant


def _contestant(spec: str, name: str) -> Contestant:
    """Return the contestant of a predictor, with the identity of its weights or source."""
    predictor = load_predictor(spec)
    expansion = predictor.config.expansion if isinstance(predictor, ImagePredictor) else None
    identity = weights_fingerprint(predictor)
    if identity is None:
        try:
            # One file may hold several predictors.
            identity = f"{spec} {checksum(Path(inspect.getfile(type(predictor))))}"
        except (TypeError, OSError):
            # The class is compiled, or was defined at a prompt.
            identity = f"{spec} {type(predictor).__qualname__}"
    return Contestant(name, spec, expansion, identity)


@dataclass(frozen=True, eq=False)
class Answer:
    """A predictor's answer about a square, (n, n) each.

    Attributes:
        image: greys in [0, 1]: free 1, unknown 0.5, occupied 0.
        kept: the same image, in which the observed cells of the input keep their value.
        p_free: probability of free; only unobserved cells count.
        p_occupied: probability of occupied; only unobserved cells count.
        nan_cells: number of cells that were NaN, which count as unknown.
    """

    image: NDArray[np.float64]
    kept: NDArray[np.float64]
    p_free: NDArray[np.float32]
    p_occupied: NDArray[np.float32]
    nan_cells: int = 0


Entrant = Callable[[ScoredSquare], Answer]
"""Function from a square to an answer; it raises BadPredictionError if the predictor breaks the
contract of predictors."""


def entrant(contestant: Contestant, rates: tuple[float, float]) -> Entrant:
    """Load a contestant's predictor, and return the function that asks it about a square.

    Args:
        contestant: predictor or baseline.
        rates: shares of free and of occupied among unobserved cells, which the baselines return as
            probabilities.
    """
    if contestant.name in BASELINES:
        return partial(_of_baseline, contestant.name, rates)
    predictor = _loaded(contestant.spec)
    if is_grey(predictor):
        return partial(_of_network, predictor)
    return partial(_of_predictor, Caller(predictor))


def is_grey(predictor: Any) -> TypeGuard[ImagePredictor | Fused]:
    """Return whether a predictor consists of networks that return a grey image, as the paper's."""
    return isinstance(predictor, ImagePredictor | Fused)


def answers_in_grey(contestant: Contestant) -> bool:
    """Return whether a contestant is such a predictor, see `is_grey`."""
    return contestant.name not in BASELINES and is_grey(_loaded(contestant.spec))


def given_to(predictor: Predictor, square: ScoredSquare) -> Grid:
    """Return the observed map that a predictor is given: the crop alone, or the whole window."""
    alone = is_grey(predictor) and predictor.given == "crop"
    return square.crop if alone else square.window


_loaded = lru_cache(maxsize=8)(load_predictor)


def _of_baseline(name: str, rates: tuple[float, float], square: ScoredSquare) -> Answer:
    """Answer with the unchanged crop, or with grey, and with the same probabilities everywhere."""
    crop = TERNARY[encode_cells(square.crop.cells)]
    image = crop if name == "copy" else np.full_like(crop, 0.5)
    free, occupied = (np.full(crop.shape, rate, np.float32) for rate in rates)
    return Answer(image, image, free, occupied)


def _of_network(predictor: ImagePredictor | Fused, square: ScoredSquare) -> Answer:
    """Answer with the raw image of a network of the paper, and the probabilities of its greys."""
    known = given_to(predictor, square)
    grey, p_free, p_occupied, _ = predictor.grey_layers(View(known, square.pose))
    if not np.isfinite(grey).all():
        raise BadPredictionError("the network returned numbers that are not finite")
    image = 0.5 + 0.5 * grey.astype(np.float64)
    kept = np.where(known.unknown, image, TERNARY[encode_cells(known.cells)])
    return Answer(image, kept, p_free, p_occupied)


def _of_predictor(caller: Caller, square: ScoredSquare) -> Answer:
    """Answer with the prediction of any other predictor, whose input is that from a planner."""
    belief = caller.ask(View(square.window, square.pose))
    image = ternary(square.window, belief)
    return Answer(image, image, belief.p_free, belief.p_occupied, belief.nan_cells)
