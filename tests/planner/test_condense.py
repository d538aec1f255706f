"""The kernels of the SQP against plain linear algebra."""

import numpy as np
import pytest

from planner.mpc.condense import condense, condense_gradient, make_positive
from planner.mpc.merit import merit
from planner.mpc.mpc import MPCConfig

N = 7


def stages(seed):
    """Random stage derivatives: dynamics near the identity, symmetric Hessians."""
    rng = np.random.default_rng(seed)
    jacobian = 0.3 * rng.normal(size=(N + 1, 6, 4))
    jacobian[:, :4] += np.eye(4)
    hessian = rng.normal(size=(N + 1, 6, 6))
    return jacobian, rng.normal(size=(N + 1, 6)), hessian + hessian.transpose(0, 2, 1)


def dense(jacobian, gradient, hessian):
    """The same by the matrix that takes all controls to all states and controls."""
    size = 2 * N
    state = np.zeros((N + 1, 4, size))
    for k in range(N):
        state[k + 1] = jacobian[k, :4].T @ state[k]
        state[k + 1][:, 2 * k : 2 * k + 2] += jacobian[k, 4:].T
    h, g = np.zeros((size, size)), np.zeros(size)
    for k in range(N + 1):
        control = np.zeros((2, size))
        if k < N:
            control[0, 2 * k] = control[1, 2 * k + 1] = 1.0
        both = np.vstack([state[k], control])
        h += both.T @ hessian[k] @ both
        g += both.T @ gradient[k]
    return h, g, state


@pytest.mark.parametrize("seed", range(5))
def test_condensing_is_the_elimination_of_the_states(seed):
    jacobian, gradient, hessian = stages(seed)
    h, g, state = dense(jacobian, gradient, hessian)
    found, sensitivity = condense(jacobian, hessian)
    assert np.allclose(found, h, atol=1e-12)
    assert np.allclose(sensitivity, state, atol=1e-12)
    assert np.allclose(condense_gradient(jacobian, gradient), g, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_eigenvalues_are_raised_and_eigenvectors_kept(seed):
    _, _, matrices = stages(seed)
    matrices[0] = 0.0
    matrices[1] = np.diag([3.0, -2.0, 0.0, 5.0, -1.0, 2.0])
    matrices[2] = matrices[2] @ matrices[2].T + np.eye(6)
    values, vectors = np.linalg.eigh(matrices)
    wanted = np.einsum("kij,kj,klj->kil", vectors, np.maximum(values, 1e-3), vectors)
    found = matrices.copy()
    make_positive(found, 1e-3)
    assert np.allclose(found, wanted, atol=1e-10)
    assert np.array_equal(found[2], matrices[2])
    assert np.array_equal(found, found.transpose(0, 2, 1))


def test_merit_adds_up():
    rng = np.random.default_rng(0)
    states, controls = rng.normal(size=(N + 1, 4)), rng.normal(size=(N, 2))
    costs, value = rng.normal(size=N), rng.uniform(-0.2, 1.0, size=(N, 2))
    kappa = np.concatenate([[0.3], controls[:, 1]])
    lacking, outside = np.maximum(0, 0.75 - value), np.maximum(0, 0.5 - value)
    wanted = (
        costs.sum()
        + 0.01 * (controls[:, 0] ** 2).sum()
        + 0.02 * (controls[:, 1] ** 2).sum()
        + 0.1 * (np.diff(kappa) ** 2).sum()
        + 2.0 * (lacking**2).sum()
        + 100.0 * (outside.sum() + 10.0 * states[-1, 3])
    )
    weights = MPCConfig(
        effort=(0.01, 0.02), smoothness=0.1, closeness=4.0, comfort=0.25, violation=100.0
    ).weights
    assert merit(states, controls, 0.3, costs, value, 0.5, weights) == pytest.approx(wanted)
