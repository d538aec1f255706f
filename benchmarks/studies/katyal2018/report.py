"""The results of an evaluation: means over frames with intervals, scores of cells, and costs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.katyal2018.contestants import BASELINES, Contestant, reduced
from benchmarks.studies.katyal2018.cost import Cost
from benchmarks.studies.katyal2018.evaluation import (
    BLOCK,
    SPLITS,
    Evaluation,
    ScoredDrive,
    describe_sets,
    expansion_key,
)
from benchmarks.studies.katyal2018.stretch_scores import OF_A_FRAME, Kept
from benchmarks.studies.katyal2018.transients import transients
from foresee.infra.environment import machine, own_version
from foresee.infra.plain_json import without_nan
from foresee.infra.results_file import write_results
from foresee.statistics import grouped_mean
from predictor.registry import load_predictor
from predictor.scoring import images
from predictor.scoring.scores import EDGES, RINGS, Scores

SSIM = {
    "simulated": {
        "1.10": {"unet_ff": 0.899, "resnet_ff": 0.861, "gan": 0.818},
        "1.30": {"unet_ff": 0.818, "resnet_ff": 0.780, "gan": 0.790},
        "1.50": {"unet_ff": 0.770, "resnet_ff": 0.773, "gan": 0.759},
        "1.70": {"unet_ff": 0.760, "resnet_ff": 0.752, "gan": 0.736},
        "2.00": {"unet_ff": 0.767, "resnet_ff": 0.770, "gan": 0.574},
    },
    "physical": {
        "1.10": {"unet_ff": 0.511, "resnet_ff": 0.523, "gan": 0.489},
        "1.30": {"unet_ff": 0.517, "resnet_ff": 0.534, "gan": 0.524},
        "1.50": {"unet_ff": 0.498, "resnet_ff": 0.489, "gan": 0.511},
        "1.70": {"unet_ff": 0.486, "resnet_ff": 0.504, "gan": 0.486},
        "2.00": {"unet_ff": 0.484, "resnet_ff": 0.499, "gan": 0.424},
    },
}
"""SSIM that Katyal et al. 2018 print in Tables I and II: place → expansion → network."""
COMPARED = ("grey", "copy", "none", "unet_ff")
"""Predictors with which all others are compared, if they are among the contestants."""
SIMILARITIES = ("ssim", "ssim_kept", "ssim_unseen", "ssim_coarse", "ssim_coarse_unseen")
"""Measures of images, one value for each frame."""
SUMMED = ("brier", "nll")
"""Measures of unobserved cells, kept as sums over each frame."""


def report(
    evaluation: Evaluation, costs: dict[tuple[str, str], Cost], published: dict[str, Any]
) -> dict[str, Any]:
    """Compute all results of an evaluation whose frames are all scored, and write results.json.

    Args:
        evaluation: the evaluation.
        costs: results of `measure_costs`.
        published: results of `published_costs`.
    """
    commits: set[str] = set()
    places = {
        place: {
            expansion_key(x): _rows(evaluation, place, x, costs, commits)
            for x in evaluation.expansions
        }
        for place in evaluation.places
    }
    results = {
        "settings": {
            "expansions": list(evaluation.expansions),
            "apart": evaluation.apart,
            "block": BLOCK,
            "ssim": images.SETTINGS,
            "ssim_coarse": images.BLOCKS,
            "rings": EDGES,
            "rates": {expansion_key(x): rate for x, rate in evaluation.rates.items()},
        },
        "sets": describe_sets(evaluation),
        "version": own_version(),
        "commits": sorted(commits),
        "machine": machine(),
        "predictors": _facts(evaluation.contestants),
        "paper": SSIM,
        "published": published,
        "transients": transients(evaluation),
        "simulated": places.pop("simulated", {}),
        "physical": places,
    }
    results = without_nan(results, digits=6)
    write_results(evaluation.out / "results.json", "prediction", results)
    return results


def _rows(
    evaluation: Evaluation,
    place: str,
    expansion: float,
    costs: dict[tuple[str, str], Cost],
    commits: set[str],
) -> dict[str, Any]:
    """Compute the measures of all contestants at one place and expansion.

    Args:
        evaluation: the evaluation.
        place: "simulated", or a site.
        expansion: expansion of the squares.
        costs: costs of all predictors.
        commits: set to which the commits are added with which the scores were made.
    """
    drives = [drive for drive in evaluation.drives if drive.place == place]
    blocks = _numbered(drives)
    rows: dict[str, Any] = {}
    frames: dict[str, Kept] = {}
    for contestant in evaluation.who(expansion):
        parts: dict[str, list[Kept]] = {}
        for drive in drives:
            for facts, arrays in evaluation.kept(drive, expansion, contestant):
                commits.add(str(facts["commit"]))
                parts.setdefault(drive.about["split"], []).append(arrays)
        kept, scores = _joined([part for split in parts.values() for part in split])
        frames[contestant.name] = kept
        rows[contestant.name] = _measures(kept, scores) | {
            "drives": len(drives),
            "rings": [{"from": EDGES[i], **_cells(scores, slice(i, i + 1))} for i in range(RINGS)],
            "reliability": {name: _curve(scores, name) for name in ("free", "occupied")},
            "cost": costs[expansion_key(expansion), contestant.name],
        }
        if len(parts) > 1:
            rows[contestant.name] |= {split: _measures(*_joined(parts[split])) for split in SPLITS}
    for name, row in rows.items():
        row["above"] = {
            other: _difference(frames[name], frames[other], blocks)
            for other in COMPARED
            if other in frames and other != name
        }
    return rows


def _joined(parts: list[Kept]) -> tuple[Kept, Scores]:
    """Return the values of all frames by name, (n,) each, and the sums over their cells."""
    scores = Scores()
    for part in parts:
        scores += Scores.of(part, "scores")
    return {name: np.concatenate([part[name] for part in parts]) for name in OF_A_FRAME}, scores


def _numbered(drives: Iterable[ScoredDrive]) -> NDArray[np.int64]:
    """Return the number of the block of each frame, counted over all drives, (n,)."""
    labels = [(drive.number, int(block)) for drive in drives for block in drive.blocks]
    return np.unique(np.array(labels), axis=0, return_inverse=True)[1].reshape(-1)


def _measures(kept: Kept, scores: Scores) -> dict[str, Any]:
    """Compute means over frames, and scores of cells."""
    out: dict[str, Any] = {"frames": len(kept["ssim"])}
    for name in SIMILARITIES:
        values = kept[name][np.isfinite(kept[name])]
        out[name] = float(values.mean()) if len(values) else np.nan
    return out | _cells(scores, slice(None)) | {"nan_cells": int(kept["nan_cells"].sum())}


def _cells(scores: Scores, rings: slice) -> dict[str, Any]:
    """Compute scores of cells; `brier` and `ece` are means over free and occupied."""
    out: dict[str, Any] = scores.measures(rings)
    out["cells"] = int(out["cells"])
    for name in ("brier", "ece"):
        out[name] = 0.5 * (out[f"{name}_free"] + out[f"{name}_occupied"])
    return out


def _curve(scores: Scores, name: str) -> dict[str, list[float]]:
    """Return the reliability diagram of "free" or "occupied"."""
    curve = zip(("given", "came_true", "share"), scores.reliability(name), strict=True)
    return {key: values.tolist() for key, values in curve}


def _difference(frames: Kept, others: Kept, blocks: NDArray[np.int64]) -> dict[str, Any]:
    """Compute the mean differences to another contestant, with 95 % intervals over blocks."""
    weights = dict.fromkeys(SIMILARITIES, np.ones(len(blocks)))
    weights |= dict.fromkeys(SUMMED, frames["cells"])
    return {
        name: grouped_mean(blocks, frames[name] - others[name], weight)
        for name, weight in weights.items()
    }


def _facts(contestants: Iterable[Contestant]) -> dict[str, Any]:
    """Return the facts of each predictor by name, and also by expansion if it can do only one.

    The fact `reduced` has the settings in which a training differs from the paper's; None: none.
    """
    names = ("fingerprint", "network", "config", "frames", "steps", "seconds", "commit")
    out: dict[str, Any] = {}
    for contestant in contestants:
        facts: dict[str, Any] = {"spec": contestant.spec, "identity": contestant.identity}
        if contestant.name not in BASELINES:
            training = getattr(load_predictor(contestant.spec), "facts", {})
            facts |= {name: training[name] for name in names if name in training}
        if contestant.expansion is None:
            out[contestant.name] = facts
        else:
            facts["reduced"] = reduced(training)
            out.setdefault(contestant.name, {})[expansion_key(contestant.expansion)] = facts
    return out
