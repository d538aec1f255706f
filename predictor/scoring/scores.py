"""How good predictions are: on cells not seen, by distance beyond the frontier.

Everything is kept as counts and sums that add up, so scores of many maps are scores of all their
cells together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from predictor.mapping.grid import Grid

EDGES = (0.0, 0.25, 0.5, 1.0, 2.0, 3.0, 5.0, np.inf)
"""Of the rings of distance beyond the frontier [m]."""
LEVELS = 1000
"""Levels of probability that are told apart, for the area under the curve."""
BINS = 20
"""Of equal width, of the reliability diagram and the calibration error."""
SMALLEST = 1e-6
"""Probabilities are not taken as smaller than this in the log-likelihood: a predictor that is
certain, and wrong, is punished by 13.8 nat and not without bound."""

RINGS = len(EDGES) - 1


@dataclass(eq=False)
class Scores:
    """Sums over cells, each by ring.

    Attributes:
        free: how often each level of p_free was given where it was not, and was, free: (RINGS,
            LEVELS, 2).
        occupied: the same, for p_occupied.
        brier_free: sum of (p_free - free)², (RINGS,).
        brier_occupied: likewise.
        nll: sum of -log of the probability of what was true [nat], (RINGS,).
        level_free: sum of p_free in each level, (RINGS, LEVELS).
        level_occupied: likewise.
    """

    free: NDArray[np.int64] = field(default_factory=lambda: np.zeros((RINGS, LEVELS, 2), np.int64))
    occupied: NDArray[np.int64] = field(
        default_factory=lambda: np.zeros((RINGS, LEVELS, 2), np.int64)
    )
    brier_free: NDArray[np.float64] = field(default_factory=lambda: np.zeros(RINGS))
    brier_occupied: NDArray[np.float64] = field(default_factory=lambda: np.zeros(RINGS))
    nll: NDArray[np.float64] = field(default_factory=lambda: np.zeros(RINGS))
    level_free: NDArray[np.float64] = field(default_factory=lambda: np.zeros((RINGS, LEVELS)))
    level_occupied: NDArray[np.float64] = field(default_factory=lambda: np.zeros((RINGS, LEVELS)))

    def add(
        self,
        p_free: NDArray[np.float32],
        p_occupied: NDArray[np.float32],
        free: NDArray[np.bool_],
        occupied: NDArray[np.bool_],
        ring: NDArray[np.int8],
    ) -> None:
        """Count some cells.

        Args:
            p_free: believed, any shape.
            p_occupied: believed.
            free: true.
            occupied: true: a surface that a ray can hit.
            ring: of each cell, of `rings`; -1: does not count.
        """
        counted = ring >= 0
        at = ring[counted].astype(np.int64)
        believed = {"free": p_free[counted], "occupied": p_occupied[counted]}
        true = {"free": free[counted], "occupied": occupied[counted]}
        for name, p in believed.items():
            level = np.minimum((p * LEVELS).astype(np.int64), LEVELS - 1)
            cell = at * LEVELS + level
            hits = np.bincount(2 * cell + true[name], minlength=2 * RINGS * LEVELS)
            getattr(self, name)[:] += hits.reshape(RINGS, LEVELS, 2)
            sums = np.bincount(cell, p, RINGS * LEVELS)
            getattr(self, f"level_{name}")[:] += sums.reshape(RINGS, LEVELS)
            square = (p - true[name]) ** 2
            getattr(self, f"brier_{name}")[:] += np.bincount(at, square, RINGS)
        hidden = 1.0 - believed["free"] - believed["occupied"]
        of_truth = np.where(
            true["free"], believed["free"], np.where(true["occupied"], believed["occupied"], hidden)
        )
        self.nll += np.bincount(at, -np.log(np.maximum(of_truth, SMALLEST)), RINGS)

    def __iadd__(self, other: Scores) -> Scores:
        for name in self.__dataclass_fields__:
            getattr(self, name)[:] += getattr(other, name)
        return self

    def arrays(self, prefix: str) -> dict[str, NDArray]:
        """Return the sums by name, after a prefix, to be kept in a file."""
        return {f"{prefix}/{name}": values for name, values in vars(self).items()}

    @classmethod
    def of(cls, arrays: Mapping[str, NDArray], prefix: str) -> Scores:
        """Return the scores that `arrays` made."""
        return cls(**{name: arrays[f"{prefix}/{name}"] for name in cls.__dataclass_fields__})

    def measures(self, rings: slice = slice(None)) -> dict[str, float]:
        """Scores of all cells of some rings: NaN where there is nothing to tell."""
        out: dict[str, float] = {"cells": float(self.free[rings].sum())}
        for name in ("free", "occupied"):
            counts = getattr(self, name)[rings].sum(axis=0)
            total = max(1, counts.sum())
            believed = counts[LEVELS // 2 :]
            union = counts[:, 1].sum() + believed[:, 0].sum()
            out[f"iou_{name}"] = believed[:, 1].sum() / union if union else np.nan
            out[f"auc_{name}"] = _area(counts)
            out[f"brier_{name}"] = getattr(self, f"brier_{name}")[rings].sum() / total
            p, rate, weight = self.reliability(name, rings)
            out[f"ece_{name}"] = float(np.nansum(weight * abs(p - rate)))
        out["nll"] = self.nll[rings].sum() / max(1.0, out["cells"])
        if not out["cells"]:
            return {name: 0.0 if name == "cells" else np.nan for name in out}
        return {name: float(value) for name, value in out.items()}

    def reliability(
        self, name: str, rings: slice = slice(None)
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """The reliability diagram of "free" or "occupied", each (BINS,).

        Returns:
            Mean probability given, rate at which it came true, share of the cells; the first two
            are NaN in an empty bin.
        """
        n, p, hits = self.bins(name, rings).T
        with np.errstate(invalid="ignore"):
            return p / n, hits / n, n / max(1.0, n.sum())

    def bins(self, name: str, rings: slice = slice(None)) -> NDArray[np.float64]:
        """Of each bin of "free" or "occupied": cells, sum of the probabilities, how many came true.

        Returns:
            (BINS, 3).
        """
        counts = getattr(self, name)[rings].sum(axis=0).reshape(BINS, -1, 2).sum(axis=1)
        sums = getattr(self, f"level_{name}")[rings].sum(axis=0).reshape(BINS, -1).sum(axis=1)
        return np.column_stack([counts.sum(axis=1), sums, counts[:, 1]]).astype(np.float64)


def calibration_interval(
    families: Sequence[Sequence[NDArray[np.float64]]], rounds: int = 2000
) -> tuple[float, float] | None:
    """95 % interval of a calibration error, buildings resampled within their families.

    The percentiles of an error, which cannot be negative: chance in few buildings raises it, so
    that the interval may lie above the error itself.

    Args:
        families: of each, `Scores.bins` of each building, (BINS, 3).
        rounds: resamplings; their seed is fixed.

    Returns:
        Its ends; None if a family has less than two buildings, or no cell.
    """
    if min(len(family) for family in families) < 2:
        return None
    rng = np.random.default_rng(0)
    drawn = np.zeros((rounds, BINS, 3))
    for family in families:
        count = len(family)
        times = rng.multinomial(count, np.full(count, 1.0 / count), rounds)
        drawn += np.tensordot(times, np.stack(family), 1)
    cells, p, hits = np.moveaxis(drawn, 2, 0)
    if not cells.any(axis=1).all():
        return None
    low, high = np.percentile(abs(p - hits).sum(axis=1) / cells.sum(axis=1), [2.5, 97.5])
    return float(low), float(high)


def _area(counts: NDArray[np.int64]) -> float:
    """Area under the receiver operating characteristic of (levels, 2) counts."""
    negative, positive = counts.sum(axis=0)
    if negative == 0 or positive == 0:
        return np.nan
    below = np.cumsum(counts[:, 0]) - counts[:, 0]
    # A tie counts half.
    return float((counts[:, 1] * (below + 0.5 * counts[:, 0])).sum() / (negative * positive))


def rings_of(known: Grid) -> NDArray[np.int8]:
    """By how far a cell not seen lies beyond the frontier, its ring of EDGES; -1: it was seen.

    The frontier is where what was seen free ends.

    Args:
        known: what was seen, (rows, columns).
    """
    if not known.free.any():
        return np.where(known.unknown, np.int8(RINGS - 1), np.int8(-1))
    beyond = np.asarray(distance_transform_edt(~known.free)) * known.frame.resolution
    ring = np.searchsorted(np.array(EDGES[1:]), beyond, side="right").astype(np.int8)
    return np.where(known.unknown, ring, np.int8(-1))
