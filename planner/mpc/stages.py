"""Stages of the optimal-control problem: dynamics and cost, which casadi differentiates."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

NX, NU = 4, 2
"""Number of entries of a state, and of a control."""
REFERENCE = 9
"""Number of entries of a stage's reference: point r (x, y), gradient g (x, y), symmetric matrix M
(xx, xy, yy), heading h and its weight w_h."""


def stage_functions(dt: float, stages: int, weights: NDArray[np.float64]) -> ca.Function:
    """Return a function that computes the derivatives of all stages of the optimal-control problem.

    The stage cost, with the entries of `REFERENCE`, is
    g·(p - r) + (p - r)ᵀM(p - r)/2 + w_h·(1 - cos(yaw - h)) + w_a·a² + w_κ·κ².

    Args:
        dt: length of a step [s].
        stages: number of stages, N + 1; the control of the last one has no effect.
        weights: weights w_a, w_κ of the squared controls, (2,).

    Returns:
        Function with the inputs state and control (6, stages), multipliers of the dynamics
        (4, stages) and references (9, stages), and the outputs Jacobian of the dynamics
        (4, 6·stages), gradient of the stage cost (6, stages) and Hessian of the stage's Lagrangian
        (6, 6·stages).
    """
    z = ca.SX.sym("z", NX + NU)
    multiplier = ca.SX.sym("multiplier", NX)
    reference = ca.SX.sym("reference", REFERENCE)
    x, y, yaw, v, a, kappa = ca.vertsplit(z)

    s = v * dt + a * dt**2 / 2
    half = kappa * s / 2
    # The series of sinc: |κs/2| < 0.4 for every car here, so the remainder is below 1e-8.
    chord = s * (1 - half**2 / 6 + half**4 / 120 - half**6 / 5040)
    successor = ca.vertcat(
        x + chord * ca.cos(yaw + half), y + chord * ca.sin(yaw + half), yaw + kappa * s, v + a * dt
    )

    off = ca.vertcat(x, y) - reference[:2]
    m = ca.vertcat(ca.horzcat(reference[4], reference[5]), ca.horzcat(reference[5], reference[6]))
    cost = ca.dot(reference[2:4], off) + ca.bilin(m, off, off) / 2
    cost += reference[8] * (1 - ca.cos(yaw - reference[7]))
    cost += weights[0] * a**2 + weights[1] * kappa**2

    hessian, _ = ca.hessian(cost + ca.dot(multiplier, successor), z)
    stage = ca.Function(
        "stage",
        [z, multiplier, reference],
        [
            ca.densify(ca.jacobian(successor, z)),
            ca.densify(ca.gradient(cost, z)),
            ca.densify(hessian),
        ],
    )
    return stage.map(stages)
