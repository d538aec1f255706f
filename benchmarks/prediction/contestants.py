"""Who is compared: predictors by name, files of weights, and all that a study has trained."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.recording.paper_drives import SimulatedConfig
from predictor.data.frames import checksum
from predictor.image_predictor import ImagePredictor
from predictor.networks.image_config import PRESETS
from predictor.provenance import fingerprint_of
from predictor.registry import FUSED, SUFFIX, PredictorError, load_predictor

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
