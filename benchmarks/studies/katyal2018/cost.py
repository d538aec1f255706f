"""The cost of a prediction: number of parameters, multiply-accumulates, and time [ms]."""

from __future__ import annotations

import time
from functools import partial
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.utils.flop_counter import FlopCounterMode

from benchmarks.studies.katyal2018.contestants import BASELINES, Contestant, given_to
from benchmarks.studies.katyal2018.evaluation import Evaluation, expansion_key, hashed
from benchmarks.studies.katyal2018.square import ScoredSquare
from benchmarks.studies.katyal2018.stretch_scores import ScoringError
from foresee.infra.environment import machine
from foresee.infra.errors import one_line
from foresee.infra.progress import progress
from foresee.mapping.context import CELLS
from foresee.mapping.conventions import CROP_CELLS
from foresee.prediction import BadPredictionError, Caller, View, checked
from predictor.compact import Compact
from predictor.data.frames import Frames
from predictor.fused import Fused
from predictor.image_predictor import ImagePredictor
from predictor.networks import PAPER
from predictor.networks.compact_net import CompactNet
from predictor.networks.grey_net import GreyNet
from predictor.networks.image_config import ImageConfig
from predictor.registry import load_predictor
from predictor.weights import load_weights

TIMED, BEFORE = 100, 3
"""Number of timed predictions, and of predictions before them to warm up."""
PUBLISHED = 10
"""Number of timed runs of a network in the paper's size, which take a second or more each."""
SQUARES = 20
"""Number of squares that predictors are asked about in turn."""

Cost = dict[str, Any] | None
"""Measures of a predictor; None for a baseline, which predicts nothing."""


def measure_costs(evaluation: Evaluation) -> dict[tuple[str, str], Cost]:
    """Measure the cost of each predictor at each expansion, once on each machine.

    It is called before scoring, so that predictors that break the contract are found early.

    Raises:
        ScoringError: if a predictor breaks the contract.
    """
    out: dict[tuple[str, str], Cost] = {}
    pairs = [(x, contestant) for x in evaluation.expansions for contestant in evaluation.who(x)]
    for expansion, contestant in progress(pairs, desc="cost", unit="predictor"):
        name = hashed("cost", contestant.identity, expansion, machine())
        out[expansion_key(expansion), contestant.name] = evaluation.store.once(
            f"{name}.json", partial(_cost, evaluation, contestant, expansion)
        )
    return out


def published_costs(evaluation: Evaluation) -> dict[str, Any]:
    """Measure the cost of the networks in the paper's size, once on each machine.

    Their weights are random, which does not change the time. They run on one thread. Only the time
    from image to image is measured, not the steps from map to image and from greys to
    probabilities.
    """
    # "printed" is the key in folders of earlier versions.
    return {
        arch: evaluation.store.once(
            f"{hashed('cost', 'printed', arch, machine())}.json", partial(_published, arch)
        )
        for arch in progress(PAPER, desc="cost as published", unit="network")
    }


def _cost(evaluation: Evaluation, contestant: Contestant, expansion: float) -> Cost:
    """Measure the cost of a contestant's predictions, one after the other on one thread."""
    if contestant.name in BASELINES:
        return None
    predictor = load_predictor(contestant.spec)
    caller = Caller(predictor)
    squares = _examples(evaluation, expansion)
    taken = []
    for square in islice(cycle(squares), BEFORE + TIMED):
        view = View(given_to(predictor, square), square.pose)
        begin = time.perf_counter()
        try:
            prediction = caller.predict(view)
            taken.append(1e3 * (time.perf_counter() - begin))
            checked(prediction, view.known)
        except Exception as error:
            line = one_line(error).removeprefix(f"{BadPredictionError.__name__}: ")
            raise ScoringError(f"{contestant.name}: {line}") from error
    timed = taken[BEFORE:]
    cost = {"ms_median": float(np.median(timed)), "ms_p99": float(np.percentile(timed, 99))}
    size = _size(contestant, predictor, len(squares[0].truth))
    return cost | {"predictions": TIMED, "threads": 1} | size


def _examples(evaluation: Evaluation, expansion: float) -> list[ScoredSquare]:
    """Return squares that are spread evenly over the test drives, or else over the logs."""
    data = evaluation.data
    frames = Frames.load(data, "test") if data is not None else evaluation.sets["physical"]
    chosen = np.unique(np.linspace(0, len(frames) - 1, SQUARES).astype(int))
    return [ScoredSquare.of(frames, int(index), expansion) for index in chosen]


def _published(arch: str) -> dict[str, Any]:
    """Measure the cost of an architecture of `PAPER` in the paper's size."""
    net = GreyNet(ImageConfig(arch)).eval()
    size = _counted(net, (1, net.config.side, net.config.side))
    given = torch.zeros(1, 1, net.config.side, net.config.side)
    taken = []
    with torch.inference_mode():
        for _ in range(1 + PUBLISHED):
            begin = time.perf_counter()
            net(given)
            taken.append(1e3 * (time.perf_counter() - begin))
    cost = {"ms_median": float(np.median(taken[1:])), "ms_most": max(taken[1:])}
    return cost | {"predictions": PUBLISHED, "threads": 1} | size


def _size(contestant: Contestant, predictor: Any, n: int) -> dict[str, Any]:
    """Count parameters and multiply-accumulates of a predictor; None if it is of another package.

    Args:
        contestant: contestant that is measured.
        predictor: its predictor.
        n: side of the predicted square [cells].
    """
    if isinstance(predictor, Compact):
        net = load_weights(predictor.weights, CompactNet)[0]
        side = n + -n % net.config.multiple
        context = [(2, CELLS, CELLS)] if net.config.context else []
        return _counted(net, (2, side, side), *context)
    weights = [Path(contestant.spec)]
    if isinstance(predictor, Fused):
        # Only the networks that the square needs are run, the narrowest first.
        narrower = sum(CROP_CELLS * part.config.expansion < n - 1e-6 for part in predictor.parts)
        weights = predictor.weights[: narrower + 1]
    elif not isinstance(predictor, ImagePredictor):
        return {"parameters": None, "macs": None}
    nets = [load_weights(path, GreyNet)[0] for path in weights]
    sizes = [_counted(net, (1, net.config.side, net.config.side)) for net in nets]
    return {name: sum(size[name] for size in sizes) for name in sizes[0]}


def _counted(net: nn.Module, *shapes: tuple[int, ...]) -> dict[str, int]:
    """Count the parameters of a network, and the multiply-accumulates of one run.

    Args:
        net: network.
        shapes: of its inputs, without their first axis.
    """
    with torch.inference_mode(), FlopCounterMode(display=False) as counter:
        net(*(torch.zeros(1, *shape) for shape in shapes))
    # The counter counts a multiplication and an addition as two operations.
    macs = counter.get_total_flops() // 2
    return {"parameters": sum(p.numel() for p in net.parameters()), "macs": macs}
