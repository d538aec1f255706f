"""Comparison of the scores on held-out drives before and after a fine-tuning."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from foresee.infra.markdown import markdown
from predictor.data.samples import Samples
from predictor.networks.compact_net import CompactNet
from predictor.scoring.scores import Scores
from predictor.training.compact_training import USUAL, VALIDATED, validate
from predictor.weights import load_weights


def table(before: Path, after: Path, samples: Samples) -> str:
    """Return a table of the scores of two networks, a row for each kind of building.

    Both are scored on at most `VALIDATED` samples of each kind. "constant" is the Brier score of
    predicting the kind's own share of free cells everywhere.

    Args:
        before: weights that the training started from.
        after: weights that it made.
        samples: held-out samples.

    Raises:
        WeightsError: if a file does not hold weights of the compact network.
    """
    nets = [load_weights(path, CompactNet)[0].eval() for path in (before, after)]
    kinds = np.array(samples.families)[samples.family_numbers]
    rows = [
        ["held-out buildings", "number", "constant"]
        + [f"{name} {when}" for name in ("Brier", "calibration") for when in ("before", "after")]
    ]
    for kind in dict.fromkeys(kinds):
        mine = np.flatnonzero(kinds == kind)
        chosen = mine[np.unique(np.linspace(0, len(mine) - 1, VALIDATED).astype(int))]
        scores = [validate(net, samples, USUAL, chosen) for net in nets]
        buildings = {samples.about[int(n)]["original"] for n in samples.places[mine, 0]}
        figures = [_constant(scores[0])] + [
            score.measures()[name] for name in ("brier_free", "ece_free") for score in scores
        ]
        rows.append([str(kind), str(len(buildings)), *(f"{figure:.3f}" for figure in figures)])
    return markdown(rows)


def _constant(scores: Scores) -> float:
    """Return the Brier score of the share of free cells."""
    truly = scores.bins("free")[:, [0, 2]].sum(axis=0)
    share = truly[1] / max(1.0, truly[0])
    return float(share * (1.0 - share))
