"""Predictors by name: entry points of packages, classes of modules, and files of weights."""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from foresee.frontiers import FrontierPredictor
from foresee.infra.errors import LineError, one_line
from foresee.infra.plug_in import PlugInError, load_plug_in
from foresee.mapping.kernels import PACKAGES
from foresee.prediction import BadPredictionError, Caller, Predictor
from predictor.instructions import settle_instructions
from predictor.provenance import weights_fingerprint
from predictor.source import Source
from predictor.weights import SUFFIX, WeightsError, read_facts

# Modules that run networks are imported where one is made: PyTorch takes seconds to import, which
# the processes of drives without a network save.

GROUP = "foresee.predictors"
"""Entry point group in which a package offers predictors."""
FUSED = "fused:"
"""Prefix of FOLDER/ARCH: the networks of an architecture in a study's folder, fused into one."""


class PredictorError(LineError):
    """There is no such predictor, or it cannot be loaded; the message is one line."""


def available() -> tuple[str, ...]:
    """Return the names that `load_predictor` knows, sorted."""
    return tuple(sorted(entry_points(group=GROUP).names))


def load_predictor(spec: str) -> Predictor:
    """Make a predictor from its name on a command line.

    Args:
        spec: a name out of `available()`, or `package.module:Class`, or the path of a .safetensors
            file that `predictor.train` has written, or `fused:FOLDER/ARCH` for all that
            `predictor.study` has trained of an architecture. The module is looked for where Python
            looks and in the current working directory; the class, or any other factory, is called
            without arguments.

    Raises:
        PredictorError: if there is no such predictor, or it cannot be made.
    """
    if spec.endswith(SUFFIX):
        factory: Any = partial(_of_weights, Path(spec))
    elif spec.startswith(FUSED):
        factory = partial(_fused, spec.removeprefix(FUSED))
    else:
        factory = _imported(spec) if is_plug_in(spec) else _named(spec)
    if not callable(factory):
        raise PredictorError(
            f"predictor {spec!r} is of type {type(factory).__name__}, it must be a class or a "
            "function that makes a predictor"
        )
    try:
        predictor = factory()
    except (Exception, SystemExit) as error:
        raise PredictorError(f"predictor {spec!r} could not be made: {one_line(error)}") from error
    try:
        Caller(predictor)
    except BadPredictionError as error:
        raise PredictorError(f"predictor {spec!r}: {error}") from error
    loaded: Predictor = predictor
    return loaded


def is_plug_in(spec: str) -> bool:
    """Return whether the name of a predictor is of the form `package.module:Class`."""
    return ":" in spec and not spec.startswith(FUSED) and not spec.endswith(SUFFIX)


def fingerprint_of(spec: str) -> str | None:
    """Return the fingerprint of a predictor: of the code of a plug-in, and of the weights.

    Code that cannot be read, such as that of a compiled module, does not count, nor does that of
    this package's own predictors, whose drives are told apart by their weights.

    Args:
        spec: name of the predictor, as for `load_predictor`.

    Returns:
        The fingerprint; None if there is neither.

    Raises:
        PredictorError: if the predictor cannot be loaded.
    """
    weights, code = weights_fingerprint(load_predictor(spec)), None
    offered = entry_points(group=GROUP, name=spec)
    plug_ins = [spec] if is_plug_in(spec) else [e.value for e in offered if _is_foreign(e)]
    for plug_in in plug_ins:
        with suppress(PlugInError):
            code = Source.of(plug_in).digest
    return " and ".join(filter(None, (code, weights))) or None


def load_frontiers(spec: str) -> FrontierPredictor:
    """Make a predictor of frontiers from its name on a command line.

    Args:
        spec: "learned", or the path of a .safetensors file that `predictor.train_frontiers` has
            written.

    Raises:
        PredictorError: if there is no such predictor, or it cannot be made.
    """
    from predictor.learned_frontiers import LearnedFrontiers

    if spec != "learned" and not spec.endswith(SUFFIX):
        raise PredictorError(
            f"no predictor of frontiers is named {spec!r}: give learned, or a file of weights, "
            f"FILE{SUFFIX}"
        )
    try:
        return LearnedFrontiers() if spec == "learned" else LearnedFrontiers(Path(spec))
    except WeightsError as error:
        raise PredictorError(f"predictor of frontiers {spec!r}: {error}") from error


def _named(name: str) -> Any:
    offered = entry_points(group=GROUP)
    if name not in offered.names:
        raise PredictorError(
            f"no predictor is named {name!r}: choose one of {', '.join(available())}, "
            f"or give package.module:Class, or a file of weights, FILE{SUFFIX}"
        )
    if _is_foreign(offered[name]):
        settle_instructions()
    try:
        return offered[name].load()
    except (Exception, SystemExit) as error:
        raise PredictorError(
            f"predictor {name!r} could not be loaded: {one_line(error)}"
        ) from error


def _fused(study: str) -> Predictor:
    """Return the networks of an architecture in a study's folder, FOLDER/ARCH, fused into one."""
    from predictor.fused import Fused

    return Fused.of_study(study)


def _of_weights(path: Path) -> Predictor:
    """Return a predictor that runs the network of a file."""
    from predictor.compact import Compact
    from predictor.image_predictor import ImagePredictor
    from predictor.networks.compact_net import CompactNet
    from predictor.networks.grey_net import GreyNet

    architecture, _ = read_facts(path)
    if architecture in CompactNet.ARCHITECTURES:
        return Compact(path)
    if architecture in GreyNet.ARCHITECTURES:
        return ImagePredictor(path)
    known = ", ".join((*CompactNet.ARCHITECTURES, *GreyNet.ARCHITECTURES))
    raise WeightsError(f"{path} holds weights of {architecture!r}, known are {known}")


def _is_foreign(entry: EntryPoint) -> bool:
    """Return whether another package offers a predictor."""
    return entry.module.partition(".")[0] not in PACKAGES


def _imported(spec: str) -> Any:
    settle_instructions()
    try:
        return load_plug_in(spec, "predictor")
    except PlugInError as error:
        raise PredictorError(str(error)) from error
