"""The faults that the planner handles."""

from __future__ import annotations

from enum import StrEnum


class Fault(StrEnum):
    """A failure of one part of the planner, with which the drive goes on.

    The values are the names in results files. docs/reference/faults.md describes the reactions.
    """

    NO_SAFE_SOLUTION = "no_safe_solution"
    """The MPC found no plan that is safe on the newest map."""
    SOLVER_FAILED = "solver_failed"
    """The solver of the MPC failed."""
    EMERGENCY = "emergency"
    """No plan at all is safe."""
    NO_LAST_RESORT = "no_last_resort"
    """No last resort remains after the first step."""
    OPEN_LOOP = "open_loop"
    """No plan from the estimated state is safe; the one that was kept still is."""
    ROLLS_BACK = "rolls_back"
    """The car rolls against its gear."""
    MISSED_TICK = "missed_tick"
    """There was no decision in time."""
    PATH_FAILED = "path_failed"
    """The path search failed."""
    TURN_FAILED = "turn_failed"
    """A turn on the spot did not end in time."""
    PREDICTOR_RAISED = "predictor_raised"
    """The predictor raised an exception."""
    PREDICTOR_LATE = "predictor_late"
    """The predictor was too late."""
    PREDICTOR_BAD = "predictor_bad"
    """The predictor returned an invalid result."""
    FRONTIERS_FAILED = "frontiers_failed"
    """The predictor of frontiers failed."""
    PREDICTOR_NAN = "predictor_nan"
    """The prediction contains NaN."""
    BAD_SCAN = "bad_scan"
    """The scan is invalid."""
