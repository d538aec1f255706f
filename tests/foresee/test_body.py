"""The laws of a rectangle on a grid."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foresee.mapping.body import Body, Scene, covered, first_contact

SHAPE, RESOLUTION, ORIGIN = (24, 30), 0.1, (-1.5, -1.2)

yaws = st.floats(-math.pi, math.pi)
places = st.floats(-0.5, 0.5)


def cells_of(x, y, yaw, body: Body) -> set[tuple[int, int]]:
    found = covered(SHAPE, RESOLUTION, ORIGIN, x, y, yaw, body.half_length, body.half_width)
    return {(int(row), int(col)) for row, col in found}


def clipped_area(x, y, yaw, body: Body, row: int, col: int) -> float:
    """Area that a cell and a rectangle share: the cell's polygon cut by the four sides."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    left, low = ORIGIN[0] + col * RESOLUTION - x, ORIGIN[1] + row * RESOLUTION - y
    corners = [
        (left + i * RESOLUTION, low + j * RESOLUTION) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))
    ]
    polygon = [(cos * a + sin * b, cos * b - sin * a) for a, b in corners]
    for axis, sign, limit in (
        (0, 1, body.half_length),
        (0, -1, body.half_length),
        (1, 1, body.half_width),
        (1, -1, body.half_width),
    ):
        kept = []
        for p, q in zip(polygon, polygon[1:] + polygon[:1], strict=True):
            inside_p, inside_q = sign * p[axis] <= limit, sign * q[axis] <= limit
            if inside_p:
                kept.append(p)
            if inside_p != inside_q:
                share = (limit - sign * p[axis]) / (sign * (q[axis] - p[axis]))
                kept.append((p[0] + share * (q[0] - p[0]), p[1] + share * (q[1] - p[1])))
        polygon = kept
    return 0.5 * abs(
        sum(
            p[0] * q[1] - q[0] * p[1]
            for p, q in zip(polygon, polygon[1:] + polygon[:1], strict=True)
        )
    )


@settings(max_examples=60, deadline=None)
@given(places, places, yaws, st.floats(0.05, 1.2), st.floats(0.05, 0.8))
def test_covered_cells_are_those_that_share_area(x, y, yaw, length, width):
    body = Body(length, width)
    found = cells_of(x, y, yaw, body)
    for row in range(SHAPE[0]):
        for col in range(SHAPE[1]):
            area = clipped_area(x, y, yaw, body, row, col)
            if area > 1e-9:
                assert (row, col) in found
            elif area == 0.0 and (row, col) in found:
                # Only touching: any larger margin shares area, any smaller misses.
                assert clipped_area(x, y, yaw, body.inflated(1e-6), row, col) > 0.0


@settings(max_examples=60, deadline=None)
@given(places, places, yaws)
def test_a_half_turn_changes_nothing(x, y, yaw):
    body = Body(0.53, 0.31)
    assert len(cells_of(x, y, yaw, body) ^ cells_of(x, y, yaw + math.pi, body)) <= 1


@settings(max_examples=60, deadline=None)
@given(places, places, yaws, st.integers(-3, 3), st.integers(-3, 3))
def test_moving_by_whole_cells_moves_the_cells(x, y, yaw, rows, cols):
    body = Body(0.53, 0.31)
    there = (x + cols * RESOLUTION, y + rows * RESOLUTION, yaw, body)
    moved = {(r + rows, c + cols) for r, c in cells_of(x, y, yaw, body)}
    for row, col in cells_of(*there) ^ moved:
        # Rounding may decide otherwise about cells that are only touched.
        assert clipped_area(*there, row, col) < 1e-9


@given(places, places, yaws, st.floats(0, 0.3))
def test_a_larger_body_covers_at_least_as_much(x, y, yaw, margin):
    body = Body(0.5, 0.3)
    assert cells_of(x, y, yaw, body) <= cells_of(x, y, yaw, body.inflated(margin))


@settings(max_examples=100, deadline=None)
@given(places, places, yaws, st.integers(0, 2**31))
def test_contact_is_meeting_a_covered_cell(x, y, yaw, seed):
    body = Body(0.5, 0.3)
    blocked = np.random.default_rng(seed).random(SHAPE) < 0.03
    expected = any(blocked[cell] for cell in cells_of(x, y, yaw, body))
    scene = Scene(blocked, RESOLUTION, ORIGIN, *body.halves)
    found = first_contact(scene, np.array([[x, y, yaw]]))
    assert found == (0 if expected else -1)


def test_the_first_contact_along_a_motion_is_named():
    blocked = np.zeros(SHAPE, bool)
    blocked[:, 25] = True
    poses = np.array([[0.1 * i - 0.5, 0.0, 0.0] for i in range(15)])
    # The wall's near side is at x = 1.0 and the front 0.25 ahead of the centre.
    assert first_contact(Scene(blocked, RESOLUTION, ORIGIN, 0.249, 0.15), poses) == 13


@pytest.mark.parametrize("pose", [(-1.4, 0, 0), (1.4, 0, 0), (0, -1.2, 0), (0, 1.1, 0), (99, 0, 0)])
def test_a_pose_that_reaches_off_the_grid_is_a_contact(pose):
    poses = np.array([pose], float)
    scene = Scene(np.zeros(SHAPE, bool), RESOLUTION, ORIGIN, 0.25, 0.15)
    assert first_contact(scene, poses) == 0


def test_the_circle_around_a_body_reaches_its_corners():
    assert Body(0.8, 0.6).radius == pytest.approx(0.5)
    assert Body(0.8, 0.6).inflated(0.1) == Body(1.0, 0.8)


@given(st.floats(0.1, 2.0), st.floats(0.1, 2.0), st.sampled_from([None, 1, 2, 3]))
def test_the_circles_of_a_body_cover_it(length, width, count):
    body = Body(length, width)
    offsets, radius = body.circles(count)
    along = np.linspace(-body.half_length, body.half_length, 41)
    # The long sides are farthest from the centres.
    distance = np.hypot(along[:, None] - offsets, body.half_width).min(axis=1)
    assert distance.max() <= radius + 1e-9
    assert radius <= body.radius + 1e-9


def test_the_circles_are_no_longer_than_the_body_is_wide():
    offsets, radius = Body(0.8, 0.3).circles()
    assert len(offsets) == 3
    assert radius == pytest.approx(math.hypot(0.8 / 6, 0.15))
