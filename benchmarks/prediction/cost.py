"""The cost of a prediction: parameters, multiply-accumulates, milliseconds."""

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
"""Number of timed predictions, and of predictions before them to warm up."""
PRINTED = 10
"""Number of timed runs of a network in the paper's size, which take a second or more each."""


def cost_of(contestant: Contestant, squares: list[ScoredSquare]) -> dict[str, Any] | None:
    """Measure the cost of a contestant's predictions, one after the other on one thread.

    Args:
        contestant: predictor; for a baseline, which predicts nothing, None is returned.
        squares: squares that it is asked about in turn.

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
    """Measure the cost of a network in the paper's size, on one thread, from image to image.

    Its weights are random, which does not change the time. The steps from map to image and from
    greys to probabilities are not included.

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
    return {
        "ms_median": float(np.median(taken[1:])),
        "ms_most": max(taken[1:]),
        "predictions": PRINTED,
        "threads": 1,
        "parameters": parameters,
        "macs": macs,
    }


def _size(contestant: Contestant, predictor: Any, n: int) -> dict[str, int | None]:
    """Count parameters and multiply-accumulates; None for a predictor of another package.

    Args:
        contestant: contestant that is measured.
        predictor: its predictor.
        n: side of the predicted square [cells].
    """
    if isinstance(predictor, Fused):
        # Networks that are wider than the square needs are not run.
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
    """Count parameters, and multiply-accumulates of one run."""
    with torch.inference_mode(), FlopCounterMode(display=False) as counter:
        net(given)
    # The counter counts a multiplication and an addition as two operations.
    return sum(p.numel() for p in net.parameters()), counter.get_total_flops() // 2
