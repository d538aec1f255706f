"""Comparison of the scores on held-out drives before and after a fine-tuning."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from foresee.infra.markdown import records
from predictor.data.samples import Samples
from predictor.networks.compact_net import CompactNet
from predictor.scoring.scores import Scores
from predictor.training.compact_training import USUAL_SIDE, VALIDATED, validate
from predictor.training.trainer import spread
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
    nets = [load_weights(path, CompactNet)[0].folded() for path in (before, after)]
    kinds = np.array(samples.families)[samples.family_numbers]
    rows = []
    for kind in dict.fromkeys(kinds):
        of_kind = np.flatnonzero(kinds == kind)
        chosen = of_kind[spread(len(of_kind), VALIDATED)]
        scores = [validate(net, samples, USUAL_SIDE, chosen) for net in nets]
        buildings = {samples.about[int(n)]["original"] for n in samples.places[of_kind, 0]}
        row = {"held-out buildings": kind, "number": len(buildings)}
        row["constant"] = f"{_constant(scores[0]):.3f}"
        for name, measure in (("Brier", "brier_free"), ("calibration", "ece_free")):
            for when, score in zip(("before", "after"), scores, strict=True):
                row[f"{name} {when}"] = f"{score.measures()[measure]:.3f}"
        rows.append(row)
    return records(rows)


def _constant(scores: Scores) -> float:
    """Return the Brier score of the share of free cells."""
    truly = scores.bins("free")[:, [0, 2]].sum(axis=0)
    share = truly[1] / max(1.0, truly[0])
    return float(share * (1.0 - share))
