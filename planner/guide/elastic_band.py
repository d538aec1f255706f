"""The line: a smooth curve along a polyline, by an elastic band (Quinlan and Khatib 1993).

A route that was found on a grid or by sampling is a polyline with kinks. The line is the curve p
near it that minimises

    ½ ∫ tension + bending · κ² + push · max(0, comfort - clearance)² + tether · |p - polyline|² ds,

with the curvature κ, by Gauss-Newton steps on evenly spaced points. The car's pose fixes the first
two points of the line, and the polyline's end fixes the last.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.kernels import njit
from planner.motion.goal import PLAN_GOAL_RADIUS
from planner.motion.path import POINT_SPACING
from planner.risk.cost_map import CostMap

BODY_MARGIN = 0.02
"""Margin that paths keep around the body's outline, or around the circles that cover it [m]."""


@dataclass(frozen=True)
class LineConfig:
    """Settings of the line.

    Attributes:
        reach: length of the part of the polyline that is smoothed, from the car on [m].
        bending: weight of the squared curvature, relative to tension [m²].
        push: weight of the squared lack of clearance, relative to tension [1/m²].
        comfort: clearances below which the line's points are pushed away from obstacles [m], tried
            in this order until the car can drive the line.
        tether: weight of the squared distance from the polyline, in unsure cells [1/m²].
        hold: weight of the squared distance from the goal, where the polyline passes it [1/m²].
        iterations: number of Gauss-Newton steps, at most; twice as many for a line that is too
            tight.
    """

    reach: float = 20.0
    bending: float = 1.0
    push: float = 60.0
    comfort: tuple[float, ...] = (0.75, 0.45)
    tether: float = 0.5
    hold: float = 500.0
    iterations: int = 15


class _BandSettings(NamedTuple):
    """Settings of `relax`; those that `LineConfig` has, too, mean the same.

    Attributes:
        bending: weight of the squared curvature, relative to tension [m²].
        push: weight of the squared lack of clearance, relative to tension [1/m²].
        comfort: clearance below which points are pushed away from obstacles [m].
        tightest: curvature above which the curve is made stiffer [1/m].
        iterations: number of Gauss-Newton steps, at most; twice as many for a curve that is too
            tight.
    """

    bending: float
    push: float
    comfort: float
    tightest: float
    iterations: int


def lines_along(
    polyline: NDArray[np.float64],
    pose: NDArray[np.float64],
    cost: CostMap,
    goal: tuple[float, float],
    tightest: float,
    config: LineConfig,
) -> Iterator[NDArray[np.float64]]:
    """Yield a line (n, 2) [m] along a polyline for each value of `config.comfort`.

    There is none along a polyline shorter than 0.5 m.

    Args:
        polyline: points of a route or path, `POINT_SPACING` apart, the first near the pose,
            (n, 2) [m].
        pose: x, y, yaw at which the line begins, (3,).
        cost: cost map, whose room the line keeps to, and in whose unsure cells it is tethered.
        goal: x, y of the goal [m]; a line passes it if its polyline does.
        tightest: curvature that the line should not exceed [1/m].
        config: settings of the line.
    """
    anchors = polyline[: round(config.reach / POINT_SPACING) + 1].copy()
    if len(anchors) < 6:
        return
    inside, rows, cols = cost.frame.locate(anchors)
    tether = np.full(len(anchors), config.tether)
    tether[inside] *= cost.unsure[rows, cols]
    passed = int(np.argmin(np.hypot(*(anchors - np.array(goal)).T)))
    if math.dist(anchors[passed], goal) < PLAN_GOAL_RADIUS:
        anchors[passed], tether[passed] = goal, config.hold
    guess, room = _from_pose(anchors, pose), cost.frame.field(cost.room)
    for comfort in config.comfort:
        settings = _BandSettings(config.bending, config.push, comfort, tightest, config.iterations)
        yield relax(guess, anchors, tether, room, settings)


def _from_pose(anchors: NDArray[np.float64], pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the anchors, the first of them shifted so that they begin at a pose."""
    guess = anchors.copy()
    fade = np.clip(1.0 - np.arange(len(guess)) * POINT_SPACING / 1.5, 0.0, None)[:, None]
    guess += fade * (pose[:2] - guess[0])
    guess[0] = pose[:2]
    guess[1] = pose[:2] + POINT_SPACING * np.array([math.cos(pose[2]), math.sin(pose[2])])
    return guess


@njit(cache=True, nogil=True)
def curvatures(points):  # type: ignore[no-untyped-def]
    """Return the signed curvature at each point of a polyline, (n,) [1/m].

    The first and the last point have the curvature of their neighbour.
    """
    n = points.shape[0]
    out = np.zeros(n)
    for i in range(1, n - 1):
        ax, ay = points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1]
        bx, by = points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]
        cx, cy = ax + bx, ay + by
        cross = ax * by - ay * bx
        if ax * bx + ay * by < 0.0:
            # The line turns back. Through three points on a straight line, the circle below would
            # have no curvature.
            shorter = min(math.hypot(ax, ay), math.hypot(bx, by))
            out[i] = math.copysign(2.0 / max(shorter, 1e-9), cross)
            continue
        product = math.sqrt((ax * ax + ay * ay) * (bx * bx + by * by) * (cx * cx + cy * cy))
        out[i] = 2.0 * cross / max(product, 1e-9)
    if n > 2:
        out[0], out[n - 1] = out[1], out[n - 2]
    return out


@njit(cache=True, nogil=True)
def relax(guess, anchors, tether, clearance, settings):  # type: ignore[no-untyped-def]
    """Return the curve (n, 2) [m] of least cost, with the first two points and the last one fixed.

    Args:
        guess: initial points of the curve, evenly spaced, (n, 2) [m].
        anchors: points to which those of the curve are tethered, (n, 2) [m].
        tether: weights of the tethers, (n,) [1/m²].
        clearance: `Field` of the distances to the nearest obstacle [m].
        settings: weights and bounds, of `_BandSettings`.
    """
    n = guess.shape[0]
    p = guess.copy()
    free = n - 3
    size = 2 * free
    h = 0.0
    for i in range(n - 1):
        h += math.hypot(anchors[i + 1, 0] - anchors[i, 0], anchors[i + 1, 1] - anchors[i, 1])
    h /= n - 1
    band = np.empty((size, 5))
    right = np.empty(size)
    stiffer = np.ones(n)
    for iteration in range(2 * settings.iterations):
        band[:] = 0.0
        right[:] = 0.0
        _add_differences(band, right, p, stiffer, 1.0 / h, settings.bending / (h * h * h))
        _add_tethers(band, right, p, anchors, tether, h)
        _add_push(band, right, p, clearance, settings.push * h, settings.comfort)
        longest = _solve(band, right)
        # The step is limited, since the slope of the clearance holds only near the old points.
        share = min(1.0, 0.3 / max(longest, 1e-9))
        for i in range(free):
            p[i + 2, 0] += share * right[2 * i]
            p[i + 2, 1] += share * right[2 * i + 1]
        if longest < 2e-3 or iteration % 5 == 4:
            bent = np.abs(curvatures(p))
            smooth = bent.max() <= settings.tightest
            if smooth and (longest < 2e-3 or iteration >= settings.iterations):
                break
            for i in range(n):
                if bent[i] > settings.tightest:
                    for j in range(max(0, i - 2), min(n, i + 3)):
                        stiffer[j] *= 1.3
    return p


@njit(cache=True, nogil=True)
def _add_differences(band, right, p, stiffer, taut, stiff):  # type: ignore[no-untyped-def]
    """Add tension and bending: squares of p_{i+1} - p_i, and of p_{i-1} - 2 p_i + p_{i+1}."""
    n = p.shape[0]
    free = n - 3
    for order in range(2):
        for first in range(n - 1 - order):
            weight = taut if order == 0 else stiff * stiffer[first + 1]
            for axis in range(2):
                if order == 0:
                    value = p[first + 1, axis] - p[first, axis]
                else:
                    value = p[first, axis] - 2.0 * p[first + 1, axis] + p[first + 2, axis]
                for a in range(order + 2):
                    ca = _factor(order, a)
                    ia = first + a - 2
                    if ia < 0 or ia >= free:
                        continue
                    right[2 * ia + axis] -= weight * ca * value
                    for b in range(a + 1):
                        ib = first + b - 2
                        if ib >= 0:
                            band[2 * ia + axis, 2 * (a - b)] += weight * ca * _factor(order, b)


@njit(cache=True, nogil=True)
def _add_tethers(band, right, p, anchors, tether, h):  # type: ignore[no-untyped-def]
    """Add the pull of each free point towards its anchor."""
    for i in range(p.shape[0] - 3):
        w = tether[i + 2] * h
        right[2 * i] -= w * (p[i + 2, 0] - anchors[i + 2, 0])
        right[2 * i + 1] -= w * (p[i + 2, 1] - anchors[i + 2, 1])
        band[2 * i, 0] += w
        band[2 * i + 1, 0] += w


@njit(cache=True, nogil=True)
def _add_push(band, right, p, clearance, w, comfort):  # type: ignore[no-untyped-def]
    """Add the push of each free point away from obstacles that are closer than `comfort`."""
    field, resolution, origin = clearance
    rows, cols = field.shape
    for i in range(p.shape[0] - 3):
        u = min(max((p[i + 2, 0] - origin[0]) / resolution - 0.5, 0.0), cols - 1.001)
        v = min(max((p[i + 2, 1] - origin[1]) / resolution - 0.5, 0.0), rows - 1.001)
        col, row = int(u), int(v)
        du, dv = u - col, v - row
        f00, f01 = field[row, col], field[row, col + 1]
        f10, f11 = field[row + 1, col], field[row + 1, col + 1]
        value = (1 - dv) * ((1 - du) * f00 + du * f01) + dv * ((1 - du) * f10 + du * f11)
        lacking = comfort - value
        if lacking > 0.0:
            gx = ((1 - dv) * (f01 - f00) + dv * (f11 - f10)) / resolution
            gy = ((1 - du) * (f10 - f00) + du * (f11 - f01)) / resolution
            right[2 * i] += w * lacking * gx
            right[2 * i + 1] += w * lacking * gy
            band[2 * i, 0] += w * gx * gx
            band[2 * i + 1, 0] += w * gy * gy
            band[2 * i + 1, 1] += w * gx * gy


@njit(cache=True, nogil=True)
def _solve(band, right):  # type: ignore[no-untyped-def]
    """Solve the banded system in place; return the largest magnitude in its solution [m]."""
    size = right.size
    # Cholesky's factor in place: L[i, i - j] is band[i, j].
    for i in range(size):
        for j in range(min(i, 4), -1, -1):
            total = band[i, j]
            for k in range(j + 1, min(i, 4) + 1):
                if k - j <= 4:
                    total -= band[i, k] * band[i - j, k - j]
            band[i, j] = math.sqrt(max(total, 1e-9)) if j == 0 else total / band[i - j, 0]
    for i in range(size):
        for k in range(1, min(i, 4) + 1):
            right[i] -= band[i, k] * right[i - k]
        right[i] /= band[i, 0]
    longest = 0.0
    for i in range(size - 1, -1, -1):
        for k in range(1, min(size - 1 - i, 4) + 1):
            right[i] -= band[i + k, k] * right[i + k]
        right[i] /= band[i, 0]
        longest = max(longest, abs(right[i]))
    return longest


@njit(cache=True, nogil=True, inline="always")
def _factor(order, k):  # type: ignore[no-untyped-def]
    """Return the factor of the k-th point in a first (order 0) or second difference (order 1)."""
    if order == 0:
        return -1.0 if k == 0 else 1.0
    return -2.0 if k == 1 else 1.0


@njit(cache=True, nogil=True)
def speeds(points, start, limits):  # type: ignore[no-untyped-def]
    """Return the highest possible speeds along a line, (n,) [m/s]: a backward and a forward pass.

    Args:
        points: points of the line, (n, 2) [m].
        start: speed at the first point [m/s].
        limits: the car's `DrivingLimits`.
    """
    n = points.shape[0]
    kappa = curvatures(points)
    squares = np.empty(n)
    for i in range(n):
        squares[i] = min(limits.v_max * limits.v_max, limits.cornering / max(abs(kappa[i]), 1e-9))
    for i in range(n - 2, -1, -1):
        step = math.hypot(points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1])
        squares[i] = min(squares[i], squares[i + 1] + 2.0 * limits.braking * step)
    # A higher speed at the start gains nothing: the car would leave the line.
    squares[0] = min(squares[0], start * start)
    for i in range(n - 1):
        step = math.hypot(points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1])
        squares[i + 1] = min(squares[i + 1], squares[i] + 2.0 * limits.acceleration * step)
    return np.sqrt(squares)
