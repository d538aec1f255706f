"""The risk map: the cells that a plan and its last resort may enter."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.grid import Grid, GridFrame
from foresee.prediction import Prediction
from planner.risk.distance_transform import distance_field


@dataclass(frozen=True, eq=False)
class RiskMap:
    """The cells that a plan (`safe`) and its last resort (`certain`) may enter.

    Attributes:
        frame: position and resolution of the cells.
        known: observed map on this frame.
        trust: confidence · p_free, the predicted probability that a cell is free; 1 where observed
            free, 0 where observed occupied, (rows, columns).
        safe: cells that a plan may enter, (rows, columns).
        certain: cells of `safe` that the last resort may enter: those observed free, those whose
            trust suffices at a level λ above 0; at ε = 0 and ε = 1 they equal `safe`,
            (rows, columns).
        plan_suffices: whether no last resort is needed apart from the plan itself: at ε = 0 the
            plan stays in observed cells, and at ε = 1 the car has no last resort.
        barred: cells observed occupied, or predicted with p_free < 0.5 at any confidence above 0:
            a plan should not end with the car's front against them, (rows, columns).
        clearance: distance to the edge of the safe set [m], negative outside of it, (rows,
            columns); what lies outside the frame is not safe.
    """

    frame: GridFrame
    known: Grid
    trust: NDArray[np.float32]
    safe: NDArray[np.bool_]
    certain: NDArray[np.bool_]
    plan_suffices: bool
    barred: NDArray[np.bool_]
    clearance: NDArray[np.float32]

    @classmethod
    def from_prediction(
        cls,
        known: Grid,
        prediction: Prediction | None,
        epsilon: float,
        level: float = 0.0,
    ) -> RiskMap:
        """Build the risk map at a reliance ε and a level λ.

        At ε = 0 only cells observed free are safe, at ε = 1 all that were not observed occupied. In
        between, an unobserved cell is safe if confidence · p_free >= 1 - ε; the safe set therefore
        never shrinks as ε, p_free or the confidence grow. NaN counts as a trust of 0. `certain` is
        decided in the same way by λ <= ε; at λ = 0 no prediction makes a cell certain, whatever its
        confidence.

        Args:
            known: observed map, on the frame of the new risk map.
            prediction: prediction on a frame of the same lattice, or None.
            epsilon: reliance ε in [0, 1].
            level: level λ of the last resort in [0, ε].

        Raises:
            ValueError: if ε lies outside [0, 1], or λ outside [0, ε].
        """
        if not 0.0 <= level <= epsilon <= 1.0:
            raise ValueError(f"level {level} and reliance {epsilon}: 0 <= level <= reliance <= 1")
        trust = known.free.astype(np.float32)
        barred = known.occupied.copy()
        if prediction is not None:
            believed = np.nan_to_num(prediction.confidence * prediction.p_free, nan=0.0)
            # A comparison with NaN is false, so a NaN bars no cell.
            blocked = (prediction.p_free < 0.5) & (prediction.confidence > 0.0)
            there, here = prediction.frame.overlap(known.frame)
            unseen = known.unknown[here]
            trust[here][unseen] = believed[there][unseen]
            barred[here] |= unseen & blocked[there]

        def enterable(doubt: float) -> NDArray[np.bool_]:
            """Return the cells that are observed free, or predicted free with a small doubt."""
            cells = known.free
            # Without any doubt allowed, only observed cells count, however sure a prediction is.
            if doubt > 0.0:
                # With a tolerance for the rounding of the single-precision product.
                cells = cells | (known.unknown & (trust >= 1.0 - doubt - 1e-6))
            return cells

        safe = enterable(epsilon)
        plan_suffices = epsilon in (0.0, 1.0)
        certain = safe if plan_suffices else enterable(level)
        clearance = _clearance(safe, known.frame.resolution)
        return cls(known.frame, known, trust, safe, certain, plan_suffices, barred, clearance)

    @cached_property
    def cautious(self) -> RiskMap:
        """The risk map of plans that may enter certain cells alone."""
        clearance = _clearance(self.certain, self.frame.resolution)
        return replace(self, safe=self.certain, plan_suffices=True, clearance=clearance)

    @cached_property
    def obstacle_distance(self) -> NDArray[np.float32]:
        """Distance to the edge of the nearest cell observed occupied [m], (rows, columns)."""
        cells = distance_field(self.known.occupied) - np.float32(0.5)
        return np.asarray(cells * np.float32(self.frame.resolution), dtype=np.float32)


def _clearance(safe: NDArray[np.bool_], resolution: float) -> NDArray[np.float32]:
    padded = np.pad(safe, 1, constant_values=False)
    unsafe = ~padded
    cells, outside = distance_field(unsafe), distance_field(padded)
    # In place: of a large square, to get memory for each step takes as long as the step.
    half = np.float32(0.5)
    cells -= half
    np.subtract(half, outside, out=cells, where=unsafe)
    return np.asarray(cells[1:-1, 1:-1] * np.float32(resolution), dtype=np.float32)
