"""The training of the layer of compact that classifies the building around the robot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from foresee.infra.progress import progress
from foresee.mapping.family_names import FAMILIES
from predictor.data.samples import Samples
from predictor.networks.compact_net import CompactNet
from predictor.training.checkpoint import TrainError
from predictor.training.compact_targets import contexts
from predictor.training.compact_training import check_unlearned, quantised
from predictor.weights import save_weights

DOUBTS = {"narrow": 60.0, "floor_plan": 15.0, "as_built": 20.0, "office": 6.0}
"""Doubt for each kind of building; 1 for all other kinds. The values were chosen by drives in a
mixture of five families and in validation maps of real buildings, see
docs/reference/cards/compact.md."""
NONE = -1
"""Number of the kind of samples that have none."""
DECAY = 0.01
"""Weight of the sum of the squared weights in the loss, for features of variance 1."""
STEPS = 200
"""Largest number of iterations of L-BFGS."""


def train_layer(
    net: CompactNet, facts: dict[str, Any], train: Samples, validation: Samples, path: Path
) -> Path:
    """Fit the layer, print its mean probabilities in other buildings, and write the network.

    Args:
        net: network with a context.
        facts: facts of its training.
        train: samples to fit it to, of two families of generated buildings at least, which become
            the kinds. One's own maps and logs are of no kind, and are left out.
        validation: samples of other buildings.
        path: path of the file to write.

    Raises:
        TrainError: if the network has no context, has learned from buildings of the validation
            samples, or there are too few families; or if there are weights at `path` already.
    """
    check_start(net, path)
    check_unlearned(facts, validation)
    if len(known_kinds(train)) < 2:
        raise TrainError(f"two families are needed; the samples are of {', '.join(train.families)}")
    fitted = fit(net, train)
    if fitted.ranges is None:
        # Weights of an earlier version.
        fitted = quantised(fitted, train)
    print(confusions(fitted, validation))
    layer = {"samples": len(train), "start": facts["fingerprint"], "decay": DECAY}
    learned = {
        name: sorted({*facts.get(name, ()), *split.worlds})
        for name, split in {"worlds": train, "validation_worlds": validation}.items()
    }
    save_weights(path, fitted, facts | learned | {"kinds": layer})
    return path


def check_start(net: CompactNet, path: Path) -> None:
    """Check that a layer can be fitted to a network, and its file be written.

    Args:
        net: network.
        path: path of the file to write.

    Raises:
        TrainError: if the network has no context, or there are weights at `path` already.
    """
    if net.context is None:
        raise TrainError("the network of --start has no context, which the layer needs")
    if path.exists():
        raise TrainError(f"{path} exists: choose another folder by --out")


def fit(net: CompactNet, samples: Samples) -> CompactNet:
    """Return a copy of a network whose layer of kinds is fitted to samples.

    The layer is a multinomial logistic regression on the summary of the context; all other weights
    stay as they are. Each family of buildings is a kind, and all have the same weight in the loss,
    whatever the number of their samples.
    """
    kinds = known_kinds(samples)
    summaries, families = summarised(net, samples, kinds)
    share = 1.0 / torch.bincount(families, minlength=len(kinds))[families]
    mean, spread = summaries.mean(dim=0), summaries.std(dim=0) + 1e-6
    layer = torch.nn.Linear(summaries.shape[1], len(kinds))
    with torch.no_grad():
        # The loss is convex, so the start decides no more than the time.
        layer.weight.zero_()
        layer.bias.zero_()
    optimiser = torch.optim.LBFGS(layer.parameters(), max_iter=STEPS, line_search_fn="strong_wolfe")
    scaled = (summaries - mean) / spread

    def loss() -> Tensor:
        optimiser.zero_grad()
        each = F.cross_entropy(layer(scaled), families, reduction="none")
        value = (each * share).sum() / share.sum() + DECAY * layer.weight.square().sum()
        value.backward()
        return value

    optimiser.step(loss)
    fitted = net.with_kinds(kinds)
    assert fitted.kinds is not None
    with torch.no_grad():
        fitted.doubts.copy_(torch.tensor([DOUBTS.get(kind, 1.0) for kind in kinds]))
        fitted.kinds.weight.copy_(layer.weight / spread)
        fitted.kinds.bias.copy_(layer.bias - (layer.weight * mean / spread).sum(dim=1))
    return fitted


def known_kinds(samples: Samples) -> tuple[str, ...]:
    """Return the families of generated buildings among samples."""
    return tuple(name for name in samples.families if name in FAMILIES)


def summarised(net: CompactNet, samples: Samples, kinds: tuple[str, ...]) -> tuple[Tensor, Tensor]:
    """Return the summary of the context of each sample of some kinds, and the number of its kind.

    The summaries are (n, 4 · width), the numbers (n,).
    """
    assert net.context is not None
    net.eval()
    found = []
    numbers = np.array([kinds.index(f) if f in kinds else NONE for f in samples.families])
    numbers = numbers[samples.family_numbers]
    wanted = np.flatnonzero(numbers != NONE)
    with torch.inference_mode():
        batches = np.array_split(wanted, max(1, len(wanted) // 64))
        for chosen in progress(batches, desc="contexts"):
            data = torch.from_numpy(samples.stacked(chosen, 100))
            none = torch.zeros(len(data), dtype=torch.bool)
            found.append(net.context(contexts(Samples.parts(data)[1], none, none, 200), 4, 4)[1])
    return torch.cat(found), torch.from_numpy(numbers[wanted])


def confusions(net: CompactNet, samples: Samples) -> str:
    """Return a table of the mean probability of each kind, one row for each family of samples."""
    families = known_kinds(samples)
    summaries, numbers = summarised(net, samples, families)
    assert net.kinds is not None
    with torch.inference_mode():
        chances: NDArray[np.float32] = torch.softmax(net.kinds(summaries), dim=1).numpy()
    width = max(map(len, net.config.kinds)) + 2
    lines = ["".join(name.rjust(width) for name in ("", *net.config.kinds))]
    for number, name in enumerate(families):
        means = chances[numbers.numpy() == number].mean(axis=0)
        lines.append(name.rjust(width) + "".join(f"{mean:.2f}".rjust(width) for mean in means))
    return "\n".join(lines)
