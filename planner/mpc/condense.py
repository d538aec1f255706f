"""Kernels of the SQP that turn the derivatives of the stages into a dense QP in the controls.

The QP's variables are a_0, κ_0, a_1, κ_1, … in this order. Sensitivities are derivatives of the
states with respect to the controls. Derivatives are laid out as casadi writes them: stage after
stage, each in column-major order, so that Jacobians appear transposed.
"""

from __future__ import annotations

import math

import numpy as np

from foresee.mapping.kernels import njit


@njit(cache=True, nogil=True)
def costates(jacobian, gradient, normal, multipliers, out):  # type: ignore[no-untyped-def]
    """Compute the multipliers of the dynamics by a backward pass, and write them to `out`.

    Row k of `out` (n, 4) belongs to the step from stage k to stage k+1.
    """
    last = out.shape[0] - 1
    here = np.zeros(4)
    for k in range(last, 0, -1):
        # `here` is ∂(cost from k+1 on)/∂x_{k+1} before, and ∂(cost from k on)/∂x_k after.
        out[k, :] = here
        after = np.zeros(4)
        for j in range(4):
            after[j] = gradient[k, j]
            if k < last:
                for i in range(4):
                    after[j] += jacobian[k, j, i] * here[i]
        for i in range(2):
            for j in range(3):
                after[j] -= multipliers[k, i] * normal[k, i, j]
        here = after
    out[0, :] = here


@njit(cache=True, nogil=True)
def make_positive(matrices, least):  # type: ignore[no-untyped-def]
    """Raise the eigenvalues of symmetric matrices (n, m, m) to at least `least`, in place.

    Cyclic Jacobi rotations (Golub & Van Loan 2013, §8.5) are faster than LAPACK at this size.
    """
    m = matrices.shape[1]
    vectors, lower = np.empty((m, m)), np.empty((m, m))
    for k in range(matrices.shape[0]):
        a = matrices[k]
        if _is_positive(a, least, lower):
            continue
        vectors[:] = 0.0
        for i in range(m):
            vectors[i, i] = 1.0
        for _ in range(30):
            off, size = 0.0, 0.0
            for i in range(m):
                size += a[i, i] * a[i, i]
                for j in range(i):
                    off += a[i, j] * a[i, j]
            if off <= 1e-24 * size:
                break
            for p in range(m - 1):
                for q in range(p + 1, m):
                    if abs(a[p, q]) <= 1e-300:
                        continue
                    theta = 0.5 * (a[q, q] - a[p, p]) / a[p, q]
                    t = 1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0))
                    if theta < 0.0:
                        t = -t
                    c = 1.0 / math.sqrt(t * t + 1.0)
                    s = t * c
                    for i in range(m):
                        x, y = a[i, p], a[i, q]
                        a[i, p], a[i, q] = c * x - s * y, s * x + c * y
                    for i in range(m):
                        x, y = a[p, i], a[q, i]
                        a[p, i], a[q, i] = c * x - s * y, s * x + c * y
                        x, y = vectors[i, p], vectors[i, q]
                        vectors[i, p], vectors[i, q] = c * x - s * y, s * x + c * y
        for i in range(m):
            a[i, i] = max(a[i, i], least)
        values = np.diag(a).copy()
        for i in range(m):
            for j in range(i + 1):
                total = 0.0
                for p in range(m):
                    total += vectors[i, p] * values[p] * vectors[j, p]
                a[i, j] = a[j, i] = total


@njit(cache=True, nogil=True)
def _is_positive(a, least, lower):  # type: ignore[no-untyped-def]
    """Return whether all eigenvalues exceed `least`: whether a - least·1 has a Cholesky factor."""
    m = a.shape[0]
    for j in range(m):
        for i in range(j, m):
            total = a[i, j]
            if i == j:
                total -= least
            for p in range(j):
                total -= lower[i, p] * lower[j, p]
            if i > j:
                lower[i, j] = total / lower[j, j]
            elif total > 0.0:
                lower[j, j] = math.sqrt(total)
            else:
                return False
    return True


@njit(cache=True, nogil=True)
def condense_gradient(jacobian, gradient):  # type: ignore[no-untyped-def]
    """Compute the gradient with respect to the controls alone, (2N,), by eliminating the states.

    Args:
        jacobian: transposed Jacobians of the dynamics with respect to state and control,
            (N+1, 6, 4); the last one is not used.
        gradient: gradients of the stages' costs with respect to state and control, (N+1, 6).
    """
    n = jacobian.shape[0] - 1
    g = np.empty(2 * n)
    costate = gradient[n, :4].copy()
    for k in range(n - 1, -1, -1):
        before = np.empty(4)
        for j in range(6):
            total = gradient[k, j]
            for i in range(4):
                total += jacobian[k, j, i] * costate[i]
            if j < 4:
                before[j] = total
            else:
                g[2 * k + j - 4] = total
        costate = before
    return g


@njit(cache=True, nogil=True)
def condense(jacobian, hessian):  # type: ignore[no-untyped-def]
    """Eliminate the states from the QP, in O(N²) (Andersson 2013, PhD thesis, §4.3).

    Args:
        jacobian: transposed Jacobians of the dynamics, as for `condense_gradient`.
        hessian: Hessians of the stages' Lagrangians, (N+1, 6, 6).

    Returns:
        Hessian with respect to the controls (2N, 2N), and sensitivities of the states
        (N+1, 4, 2N).
    """
    n = jacobian.shape[0] - 1
    size = 2 * n
    s = np.zeros((n + 1, 4, size))
    h = np.zeros((size, size))
    here, weighted, above = np.empty((4, 2)), np.empty((4, 2)), np.empty((4, 2))
    for j in range(n):
        # Forward pass: how the later states depend on the controls of stage j.
        for i in range(4):
            s[j + 1, i, 2 * j] = jacobian[j, 4, i]
            s[j + 1, i, 2 * j + 1] = jacobian[j, 5, i]
        for k in range(j + 1, n):
            for i in range(4):
                for u in range(2):
                    total = 0.0
                    for m in range(4):
                        total += jacobian[k, m, i] * s[k, m, 2 * j + u]
                    s[k + 1, i, 2 * j + u] = total
        # Backward pass: how the gradient depends on these controls, two columns of the Hessian.
        weighted[:] = 0.0
        for k in range(n, j, -1):
            for m in range(4):
                for u in range(2):
                    here[m, u] = s[k, m, 2 * j + u]
            if k < n:
                for i in range(2):
                    for u in range(2):
                        total = 0.0
                        for m in range(4):
                            total += jacobian[k, 4 + i, m] * weighted[m, u]
                            total += hessian[k, 4 + i, m] * here[m, u]
                        h[2 * k + i, 2 * j + u] = total
                        h[2 * j + u, 2 * k + i] = total
            for i in range(4):
                for u in range(2):
                    total = 0.0
                    for m in range(4):
                        total += hessian[k, i, m] * here[m, u]
                        if k < n:
                            total += jacobian[k, i, m] * weighted[m, u]
                    above[i, u] = total
            weighted[:] = above
        for i in range(2):
            for u in range(2):
                total = hessian[j, 4 + i, 4 + u]
                for m in range(4):
                    total += jacobian[j, 4 + i, m] * weighted[m, u]
                h[2 * j + i, 2 * j + u] = total
    return h, s


@njit(cache=True, nogil=True)
def add_smoothness_gradient(g, controls, last, weight):  # type: ignore[no-untyped-def]
    """Add the gradient of weight · Σ (κ_k - κ_{k-1})², the cost of changes of curvature, in place.

    `last` is κ_{-1}, the curvature before the plan [1/m].
    """
    before = last
    for k in range(controls.shape[0]):
        i = 2 * k + 1
        change = controls[k, 1] - before
        before = controls[k, 1]
        g[i] += 2 * weight * change
        if k > 0:
            g[i - 2] -= 2 * weight * change


@njit(cache=True, nogil=True)
def add_smoothness(h, weight):  # type: ignore[no-untyped-def]
    """Add the Hessian of the cost of changes of curvature, in place."""
    for i in range(1, h.shape[0], 2):
        h[i, i] += 2 * weight
        if i > 1:
            h[i - 2, i - 2] += 2 * weight
            h[i, i - 2] -= 2 * weight
            h[i - 2, i] -= 2 * weight
