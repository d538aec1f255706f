"""The merit of a plan: the cost that the MPC lowers."""

from __future__ import annotations

from typing import NamedTuple

from foresee.mapping.kernels import njit


class Weights(NamedTuple):
    """Weights of the cost, as kernels read them; `MPCConfig` describes them.

    Attributes:
        progress: reward for a metre of progress.
        contour: weight w of the cost w/2 · d², with the distance d from the path [m].
        final_contour: the same weight at the last state, and at the end of the path.
        final_heading: cost of 1 - cos(heading error) at the last state.
        acceleration: cost of a².
        curvature: cost of κ².
        smoothness: cost of a squared change of κ.
        closeness: weight w of the cost w/2 · d², with the shortfall d from the comfortable
            clearance [m].
        comfort: difference between the comfortable clearance and the required one [m].
        violation: cost of a shortfall of 1 m from the required clearance; a speed of 1 m/s at the
            plan's end costs ten times as much.
    """

    progress: float
    contour: float
    final_contour: float
    final_heading: float
    acceleration: float
    curvature: float
    smoothness: float
    closeness: float
    comfort: float
    violation: float


@njit(cache=True, nogil=True)
def merit(states, controls, last_curvature, path_costs, clearances, required, weights):  # type: ignore[no-untyped-def]
    """Compute the merit of a plan.

    Args:
        states: states of the plan, (N+1, 4).
        controls: controls of the plan, (N, 2).
        last_curvature: curvature that the car drove before the plan [1/m].
        path_costs: cost of each state after the first by its reference on the path, (N,).
        clearances: clearances of the two circles at these states, (N, 2) [m].
        required: required clearance [m].
        weights: `Weights` of the cost.
    """
    total = 10.0 * weights.violation * states[-1, 3]
    before = last_curvature
    for k in range(controls.shape[0]):
        a, kappa = controls[k, 0], controls[k, 1]
        total += path_costs[k] + weights.acceleration * a * a + weights.curvature * kappa * kappa
        total += weights.smoothness * (kappa - before) ** 2
        before = kappa
        for i in range(2):
            lacking = max(0.0, required + weights.comfort - clearances[k, i])
            total += 0.5 * weights.closeness * lacking * lacking
            total += weights.violation * max(0.0, required - clearances[k, i])
    return total
