"""The training of the layer of compact that tells kinds of building apart."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from foresee.infra.progress import progress
from predictor.data.samples import Samples
from predictor.networks.compact_net import CompactNet
from predictor.training.checkpoint import TrainError
from predictor.training.compact_targets import contexts
from predictor.weights import save_weights

DOUBTS = {"narrow": 30.0, "floor_plan": 6.0, "as_built": 6.0, "office": 3.0}
"""Doubt in each kind of building; 1 in all others. Chosen by drives in generated buildings with
seeds 41000 to 41009, see docs/results/risk.md."""
NONE = -1
"""Number of a family of samples that is no kind of the network."""
DECAY = 0.01
"""Weight of the sum of the squared weights in the loss, for features of variance 1."""
STEPS = 200
"""Largest number of iterations of L-BFGS."""


def train_layer(
    net: CompactNet, facts: dict[str, Any], train: Samples, validation: Samples, path: Path
) -> Path:
    """Fit the layer, print what it tells in other buildings, and write the whole network.

    Args:
        net: network with a context.
        facts: facts of its training.
        train: samples to fit it to, of two families at least, which become the kinds.
        validation: samples of other buildings.
        path: path of the file to write.

    Raises:
        TrainError: if the network has no context, or all samples are of one family.
    """
    if net.context is None:
        raise TrainError("the network of --start has no context, from which kinds are told")
    if len(train.families) < 2:
        raise TrainError(f"all samples are of the kind {train.families[0]!r}, two are needed")
    fitted = fit(net, train)
    print(confusions(fitted, validation))
    layer = {"samples": len(train), "start": facts["fingerprint"], "decay": DECAY}
    learned = {
        name: sorted({*facts.get(name, ()), *split.worlds})
        for name, split in {"worlds": train, "validation_worlds": validation}.items()
    }
    save_weights(path, fitted, facts | learned | {"kinds": layer})
    return path


def fit(net: CompactNet, samples: Samples) -> CompactNet:
    """Return a copy of a network whose layer of kinds is fitted to samples.

    The layer is a multinomial logistic regression on the summary of the context; all other weights
    stay as they are. Each family of buildings is a kind, and all have the same weight in the loss,
    whatever the number of their samples.
    """
    summaries, families = summarised(net, samples)
    share = 1.0 / torch.bincount(families)[families]
    mean, spread = summaries.mean(dim=0), summaries.std(dim=0) + 1e-6
    layer = torch.nn.Linear(summaries.shape[1], len(samples.families))
    with torch.no_grad():
        # The loss is convex, so the start decides no more than the time.
        layer.weight.zero_()
        layer.bias.zero_()
    optimiser = torch.optim.LBFGS(layer.parameters(), max_iter=STEPS)
    scaled = (summaries - mean) / spread

    def loss() -> Tensor:
        optimiser.zero_grad()
        each = F.cross_entropy(layer(scaled), families, reduction="none")
        value = (each * share).sum() / share.sum() + DECAY * layer.weight.square().sum()
        value.backward()
        return value

    optimiser.step(loss)
    kinds = tuple(samples.families)
    fitted = net.with_kinds(kinds)
    assert fitted.kinds is not None
    with torch.no_grad():
        fitted.doubts.copy_(torch.tensor([DOUBTS.get(kind, 1.0) for kind in kinds]))
        fitted.kinds.weight.copy_(layer.weight / spread)
        fitted.kinds.bias.copy_(layer.bias - (layer.weight * mean / spread).sum(dim=1))
    return fitted


def summarised(net: CompactNet, samples: Samples) -> tuple[Tensor, Tensor]:
    """Return the summary of each sample's context, (n, 4 · width), and the number of its family."""
    assert net.context is not None
    net.eval()
    found = []
    with torch.inference_mode():
        batches = np.array_split(np.arange(len(samples)), max(1, len(samples) // 64))
        for chosen in progress(batches, desc="contexts"):
            data = torch.from_numpy(samples.stacked(chosen, 100))
            none = torch.zeros(len(data), dtype=torch.bool)
            found.append(net.context(contexts(Samples.parts(data)[1], none, none, 200), 4, 4)[1])
    return torch.cat(found).clone(), torch.from_numpy(samples.family_numbers)


def kind_numbers(net: CompactNet, families: list[str]) -> Tensor:
    """Return the number of the kind of each family; `NONE` if it is none of the network."""
    kinds = net.config.kinds
    return torch.tensor([kinds.index(name) if name in kinds else NONE for name in families])


def confusions(net: CompactNet, samples: Samples) -> str:
    """Return a table of the mean probability of each kind, one row for each family of samples."""
    summaries, families = summarised(net, samples)
    assert net.kinds is not None
    with torch.inference_mode():
        chances: NDArray[np.float32] = torch.softmax(net.kinds(summaries), dim=1).numpy()
    width = max(map(len, net.config.kinds)) + 2
    lines = ["".join(name.rjust(width) for name in ("", *net.config.kinds))]
    for number, name in enumerate(samples.families):
        means = chances[families.numpy() == number].mean(axis=0)
        lines.append(name.rjust(width) + "".join(f"{mean:.2f}".rjust(width) for mean in means))
    return "\n".join(lines)
