"""Scores of predictions on unobserved cells, by the cells' distance beyond the frontier.

Scores are kept as counts and sums, so that those of several maps can be added.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from foresee.mapping.grid import Grid
from foresee.statistics import interval

EDGES = (0.0, 0.25, 0.5, 1.0, 2.0, 3.0, 5.0, np.inf)
"""Edges of the rings of distance beyond the frontier [m]."""
LEVELS = 1000
"""Number of levels of probability that are distinguished for the area under the curve."""
BINS = 20
"""Number of bins, of equal width, of the reliability diagram and of the calibration error."""
SMALLEST = 1e-6
"""Smallest probability in the log-likelihood, so that a certain but wrong prediction costs 13.8 nat
and not infinity."""

RINGS = len(EDGES) - 1


@dataclass(eq=False)
class Scores:
    """Sums over cells, for each ring.

    Attributes:
        free: number of cells at each level of p_free that are not free, and that are free, (RINGS,
            LEVELS, 2).
        occupied: the same for p_occupied.
        brier_free: sum of (p_free - free)², (RINGS,).
        brier_occupied: the same for p_occupied.
        nll: sum of -log of the probability of the true class [nat], (RINGS,).
        level_free: sum of p_free in each level, (RINGS, LEVELS).
        level_occupied: the same for p_occupied.
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
        """Add some cells.

        Args:
            p_free: predicted probability of free, any shape.
            p_occupied: predicted probability of occupied, the same shape.
            free: which cells are truly free.
            occupied: which cells are truly a surface that a ray can hit.
            ring: ring of each cell, see `cell_rings`; -1: the cell does not count.
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
        of_truth = np.select([*true.values()], [*believed.values()], hidden)
        self.nll += np.bincount(at, -np.log(np.maximum(of_truth, SMALLEST)), RINGS)

    def __iadd__(self, other: Scores) -> Scores:
        for name in self.__dataclass_fields__:
            getattr(self, name)[:] += getattr(other, name)
        return self

    def arrays(self, prefix: str) -> dict[str, NDArray[Any]]:
        """Return the sums by name, after a prefix, to be kept in a file."""
        return {f"{prefix}/{name}": values for name, values in vars(self).items()}

    @classmethod
    def of(cls, arrays: Mapping[str, NDArray[Any]], prefix: str) -> Scores:
        """Return the scores that `arrays` made."""
        return cls(**{name: arrays[f"{prefix}/{name}"] for name in cls.__dataclass_fields__})

    def measures(self, rings: slice = slice(None)) -> dict[str, float]:
        """Compute the scores of all cells in some rings.

        Args:
            rings: numbers of the rings.

        Returns:
            `cells`, their number; `nll` [nat]; and for free and for occupied `iou_…`, `auc_…` (area
            under the ROC curve), `brier_…` and `ece_…` (expected calibration error). All but
            `cells` are NaN if there are no cells.
        """
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
        """Compute the reliability diagram of "free" or "occupied".

        Returns:
            Mean predicted probability, observed rate, and share of the cells in each bin, (BINS,)
            each; the first two are NaN in an empty bin.
        """
        n, p, hits = self.bins(name, rings).T
        with np.errstate(invalid="ignore"):
            return p / n, hits / n, n / max(1.0, n.sum())

    def bins(self, name: str, rings: slice = slice(None)) -> NDArray[np.float64]:
        """Compute the bins of the reliability diagram of "free" or "occupied".

        Returns:
            Number of cells, sum of their probabilities, and number that came true, (BINS, 3).
        """
        counts = getattr(self, name)[rings].sum(axis=0).reshape(BINS, -1, 2).sum(axis=1)
        sums = getattr(self, f"level_{name}")[rings].sum(axis=0).reshape(BINS, -1).sum(axis=1)
        return np.column_stack([counts.sum(axis=1), sums, counts[:, 1]]).astype(np.float64)


def calibration_interval(
    families: Sequence[Sequence[NDArray[np.float64]]],
) -> tuple[float, float] | None:
    """Compute the 95 % interval of a calibration error, over buildings within families.

    Args:
        families: for each family, `Scores.bins` of each building, (BINS, 3).

    Returns:
        Both ends; None if `foresee.statistics.interval` gives none, or there is no cell.
    """
    strata = [np.stack(family).reshape(len(family), -1).T for family in families]
    return interval(strata, _calibration_error, (0.0, 1.0))


def _calibration_error(sums: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the calibration error of sums of `Scores.bins`, (3 * BINS, n); NaN without a cell."""
    cells, p, hits = np.moveaxis(sums.reshape(BINS, 3, -1), 1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(abs(p - hits).sum(axis=0) / cells.sum(axis=0))


def _area(counts: NDArray[np.int64]) -> float:
    """Compute the area under the receiver operating characteristic of (levels, 2) counts."""
    negative, positive = counts.sum(axis=0)
    if negative == 0 or positive == 0:
        return np.nan
    below = np.cumsum(counts[:, 0]) - counts[:, 0]
    # A tie counts half.
    return float((counts[:, 1] * (below + 0.5 * counts[:, 0])).sum() / (negative * positive))


def cell_rings(known: Grid) -> NDArray[np.int8]:
    """Return the ring of EDGES that each cell lies in, (rows, columns); -1 for observed cells.

    The distance of a cell beyond the frontier is that to the nearest cell observed free.

    Args:
        known: map of all that was observed, (rows, columns).
    """
    if not known.free.any():
        return np.where(known.unknown, np.int8(RINGS - 1), np.int8(-1))
    beyond = np.asarray(distance_transform_edt(~known.free)) * known.frame.resolution
    ring = np.searchsorted(np.array(EDGES[1:]), beyond, side="right").astype(np.int8)
    return np.where(known.unknown, ring, np.int8(-1))
