"""The clearance of the body along a plan, and the derivatives of its cost."""

from __future__ import annotations

import math

import numpy as np

from foresee.mapping.kernels import njit


@njit(cache=True, nogil=True)
def clearances(field, states, offset):  # type: ignore[no-untyped-def]
    """Compute the clearance of two circles at ± `offset` [m] along the heading of each state.

    The field is interpolated by cubic convolution (Keys 1981), which makes its gradient continuous
    and needs no prefilter. Outside the field the values at its border hold.

    Args:
        field: `Field` of the clearances at the cells' centres [m].
        states: x, y, yaw, v of the states, (n, 4).
        offset: distance of the circles' centres from the body's centre [m].

    Returns:
        Clearances (n, 2) [m], and their gradients with respect to x, y, yaw (n, 2, 3).
    """
    n = states.shape[0]
    distances, resolution, origin = field
    rows, cols = distances.shape
    values = np.empty((n, 2))
    gradients = np.empty((n, 2, 3))
    wx, wy, dx, dy = np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    for k in range(n):
        cos, sin = math.cos(states[k, 2]), math.sin(states[k, 2])
        for i in range(2):
            o = offset if i == 0 else -offset
            u = (states[k, 0] + o * cos - origin[0]) / resolution - 0.5
            w = (states[k, 1] + o * sin - origin[1]) / resolution - 0.5
            u = min(max(u, 1.0), cols - 2.001)
            w = min(max(w, 1.0), rows - 2.001)
            col, row = math.floor(u), math.floor(w)
            _keys(u - col, wx, dx)
            _keys(w - row, wy, dy)
            f, fu, fw = 0.0, 0.0, 0.0
            for p in range(4):
                for q in range(4):
                    value = distances[min(row - 1 + p, rows - 1), min(col - 1 + q, cols - 1)]
                    f += wy[p] * wx[q] * value
                    fu += wy[p] * dx[q] * value
                    fw += dy[p] * wx[q] * value
            fu, fw = fu / resolution, fw / resolution
            values[k, i] = f
            gradients[k, i, 0] = fu
            gradients[k, i, 1] = fw
            gradients[k, i, 2] = o * (fw * cos - fu * sin)
    return values, gradients


@njit(cache=True, nogil=True, inline="always")
def _keys(t, weight, slope):  # type: ignore[no-untyped-def]
    """Write Keys' weights of four neighbours at a fraction t of a cell, and their derivatives."""
    weight[0] = ((-0.5 * t + 1.0) * t - 0.5) * t
    weight[1] = (1.5 * t - 2.5) * t * t + 1.0
    weight[2] = ((-1.5 * t + 2.0) * t + 0.5) * t
    weight[3] = (0.5 * t - 0.5) * t * t
    slope[0] = (-1.5 * t + 2.0) * t - 0.5
    slope[1] = (4.5 * t - 5.0) * t
    slope[2] = (-4.5 * t + 4.0) * t + 0.5
    slope[3] = (1.5 * t - 1.0) * t


@njit(cache=True, nogil=True)
def add_closeness_gradient(gradient, lacking, normal, weight):  # type: ignore[no-untyped-def]
    """Add the gradient of the cost of closeness to the stages' gradients, in place.

    Args:
        gradient: gradients of the stages' costs, (n, 6).
        lacking: shortfall of each circle from the comfortable clearance [m], (n, 2).
        normal: gradients of the clearances with respect to x, y, yaw, (n, 2, 3).
        weight: weight w of the cost w/2 · lacking².
    """
    for k in range(lacking.shape[0]):
        for i in range(2):
            for j in range(3):
                gradient[k, j] -= weight * lacking[k, i] * normal[k, i, j]


@njit(cache=True, nogil=True)
def add_closeness_hessian(hessian, lacking, normal, weight):  # type: ignore[no-untyped-def]
    """Add the Gauss-Newton Hessian of the cost of closeness to Hessians (n, 6, 6), in place."""
    for k in range(lacking.shape[0]):
        for i in range(2):
            if lacking[k, i] > 0.0:
                for j in range(3):
                    for m in range(3):
                        hessian[k, j, m] += weight * normal[k, i, j] * normal[k, i, m]
