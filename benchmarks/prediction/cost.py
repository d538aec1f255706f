"""What a prediction costs: parameters, multiply-accumulates, milliseconds."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.utils.flop_counter import FlopCounterMode

from benchmarks.prediction.contestants import BASELINES, Contestant, is_printed
from benchmarks.prediction.scoring import ScoringError
from benchmarks.prediction.square import ScoredSquare
from predictor.compact import Compact
from predictor.fused import Fused
from predictor.image_predictor import ImagePredictor
from predictor.infra.errors import one_line
from predictor.networks.compact_net import CompactNet
from predictor.networks.image_config import ImageConfig
from predictor.networks.image_net import ImageNet
from predictor.prediction import BadPredictionError, checked
from predictor.registry import load_predictor
from predictor.weights import load_weights

TIMED, BEFORE = 100, 3
"""Predictions that are timed, and those made before, in which libraries get ready."""
PRINTED = 10
"""Runs that are timed of a network as the paper prints it, which takes a second or more."""


def cost_of(contestant: Contestant, squares: list[ScoredSquare]) -> dict[str, Any] | None:
    """What a contestant's predictions cost, made one after the other on one thread.

    Args:
        contestant: who; None is returned for a baseline, which predicts nothing.
        squares: that it is asked about, in turn.

    Raises:
        ScoringError: if it breaks the contract of predictors.
    """
    if contestant.name in BASELINES:
        return None
    predictor = load_predictor(contestant.spec)
    taken = []
    for number in range(BEFORE + TIMED):
        square = squares[number % len(squares)]
        known = square.crop if is_printed(predictor) else square.window
        begin = time.perf_counter()
        try:
            prediction = predictor.predict(known, square.pose)
            taken.append(1e3 * (time.perf_counter() - begin))
            checked(prediction, known)
        except Exception as error:
            line = one_line(error)
            line = line.removeprefix(f"{BadPredictionError.__name__}: ")
            raise ScoringError(f"{contestant.name}: {line}") from error
    timed = np.array(taken[BEFORE:])
    return {
        "ms_median": float(np.median(timed)),
        "ms_p99": float(np.percentile(timed, 99)),
        "predictions": TIMED,
        "threads": 1,
        **_size(contestant, predictor, len(squares[0].truth)),
    }


def printed_cost(arch: str) -> dict[str, Any]:
    """What a network costs as the paper prints it, whole: on one thread, from image to image.

    Its weights are random, which changes no time. What a predictor adds, from map to image and from
    greys to probabilities, is left out.

    Args:
        arch: one of `predictor.networks.ARCHITECTURES`.
    """
    net = ImageNet(ImageConfig(arch)).eval()
    given = torch.zeros(1, 1, net.config.side, net.config.side)
    parameters, macs = _counted(net, given)
    taken = []
    with torch.inference_mode():
        for _ in range(1 + PRINTED):
            begin = time.perf_counter()
            net(given)
            taken.append(1e3 * (time.perf_counter() - begin))
    return {"ms_median": float(np.median(taken[1:])), "ms_most": max(taken[1:]),
            "predictions": PRINTED, "threads": 1, "parameters": parameters,
            "macs": macs}  # fmt: skip


def _size(contestant: Contestant, predictor: Any, n: int) -> dict[str, int | None]:
    """Parameters and multiply-accumulates of a network; None of what is none of ours.

    Args:
        contestant: who.
        predictor: the same.
        n: side of the predicted square [cells].
    """
    if isinstance(predictor, Fused):
        # Wider networks than the square needs are not asked.
        narrower = sum(100 * part.config.expansion < n - 1e-6 for part in predictor.parts)
        sizes = [_of_image(path) for path in predictor.weights[: narrower + 1]]
    elif isinstance(predictor, ImagePredictor):
        sizes = [_of_image(Path(contestant.spec))]
    elif isinstance(predictor, Compact):
        net = load_weights(predictor.weights, CompactNet)[0]
        side = n + -n % net.config.multiple
        sizes = [_counted(net, torch.zeros(1, 2, side, side))]
    else:
        return {"parameters": None, "macs": None}
    parameters, macs = map(sum, zip(*sizes, strict=True))
    return {"parameters": parameters, "macs": macs}


def _of_image(weights: Path) -> tuple[int, int]:
    net = load_weights(weights, ImageNet)[0]
    return _counted(net, torch.zeros(1, 1, net.config.side, net.config.side))


def _counted(net: torch.nn.Module, given: torch.Tensor) -> tuple[int, int]:
    """Parameters, and multiply-accumulates of one run."""
    with torch.inference_mode(), FlopCounterMode(display=False) as counter:
        net(given)
    # A multiplication and an addition count as two there.
    return sum(p.numel() for p in net.parameters()), counter.get_total_flops() // 2
