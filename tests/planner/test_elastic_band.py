"""The laws of the line: its shape, its curvature, and how fast it is driven."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rooms import CAR, RESOLUTION, Room, length, wrapped

from foresee.mapping.grid import OCCUPIED
from planner.guide.elastic_band import LineConfig, curvatures, lines_along, speeds
from planner.motion.path import POINT_SPACING, Path
from planner.risk.distance_transform import distance_field

CONFIG = LineConfig()
LIMITS = CAR.driving
ANYWHERE = (100.0, 100.0)
"""A goal that no way here passes."""


def lines_in(room, vertices, pose, unsure=False, goal=ANYWHERE, config=CONFIG):
    """A way through a room, and the lines along it; unsure: everywhere or nowhere."""
    way = Path.through(np.array(vertices), "").points
    cost = replace(
        room.cost,
        frame=room.frame,
        room=distance_field(room.cells == OCCUPIED) * np.float32(RESOLUTION),
        unsure=np.full(room.frame.shape, unsure),
    )
    return way, list(
        lines_along(
            way,
            np.array(pose, dtype=float),
            cost,
            goal,
            0.95 * CAR.max_curvature,
            config,
        )
    )


def line_in(*args, **settings):
    """A way through a room, and the first line along it."""
    way, lines = lines_in(*args, **settings)
    return way, lines[0]


def seconds(points, start) -> float:
    """The time of the fastest drive along a line [s]."""
    v = speeds(points, start, LIMITS)
    return float((2 * np.hypot(*np.diff(points, axis=0).T) / (v[1:] + v[:-1])).sum())


def corner(width=2.0):
    """Two corridors that meet: along the bottom, and up at the right."""
    return Room(8.0, 8.0).fill((-0.2, 8.0 - width), (width, 8.2))


def off(points, way) -> float:
    """The most that points lie off a densely sampled way [m]."""
    return float(max(np.hypot(*(way - point).T).min() for point in points))


@pytest.mark.parametrize("unsure", [True, False])
@given(angle=st.floats(-math.pi, math.pi))
def test_a_straight_way_stays_straight(unsure, angle):
    ahead = np.array([math.cos(angle), math.sin(angle)])
    start = np.array([10.0, 10.0])
    way, line = line_in(
        Room(20.0, 20.0), [start, start + 5.999999 * ahead], (*start, angle), unsure=unsure
    )
    assert line == pytest.approx(way, abs=1e-5)


@given(
    x=st.floats(1.6, 2.4),
    y=st.floats(0.7, 1.3),
    yaw=st.floats(-0.7, 0.7),
    unsure=st.booleans(),
)
def test_a_line_begins_at_the_pose_in_its_heading_and_ends_where_the_way_ends(x, y, yaw, unsure):
    way, line = line_in(corner(), [(2.0, 1.0), (7.0, 1.0), (7.0, 6.0)], (x, y, yaw), unsure=unsure)
    assert np.isfinite(line).all()
    assert line[0] == pytest.approx([x, y], abs=1e-9)
    ahead = line[1] - line[0]
    assert float(wrapped(math.atan2(ahead[1], ahead[0]) - yaw)) == pytest.approx(0.0, abs=1e-9)
    assert line[-1] == pytest.approx(way[-1], abs=1e-9)


def test_a_line_reaches_as_far_as_it_is_told():
    config = LineConfig(reach=4.0)
    way, line = line_in(Room(12.0, 4.0), [(1.0, 2.0), (11.0, 2.0)], (1.0, 2.0, 0.0), config=config)
    assert line[-1] == pytest.approx(way[round(4.0 / POINT_SPACING)])


@pytest.mark.parametrize("width", [1.4, 2.0, 3.0])
def test_round_a_corner_a_line_keeps_its_curvature_and_its_clearance(width):
    room, middle = corner(width), 0.5 * width
    way = [(1.0, middle), (8.0 - middle, middle), (8.0 - middle, 7.0)]
    # In the narrowest the first lies in the middle, and is too sharp for the car.
    line = lines_in(room, way, (1.0, middle, 0.0))[1][0 if width > 1.5 else 1]
    clearance = distance_field(room.cells == OCCUPIED) * RESOLUTION
    assert np.abs(curvatures(line)).max() <= CAR.max_curvature
    cells = np.array([room.frame.cell(*point) for point in line])
    assert clearance[tuple(cells.T)].min() > CAR.body.half_width + 0.1


@pytest.mark.parametrize("aside", [-0.3, -0.15, 0.15, 0.3])
def test_a_line_passes_the_goal_that_its_way_passes(aside):
    room, goal = Room(14.0, 5.0), (6.0, 2.5 + aside)
    _, line = line_in(room, [(1.0, 2.5), (10.0, 2.5)], (1.0, 2.5, 0.0), goal=goal)
    assert np.hypot(*(line - goal).T).min() < 0.1


def test_what_is_not_sure_keeps_a_line_near_its_way_and_elsewhere_it_is_shorter():
    room = Room(12.0, 12.0)
    vertices, pose = [(1.0, 1.0), (8.0, 1.0), (8.0, 8.0)], (1.0, 1.0, 0.0)
    way, kept = line_in(room, vertices, pose, unsure=True)
    _, free = line_in(room, vertices, pose, unsure=False)
    assert off(kept, way) < 0.5 * off(free, way)
    assert length(free) < length(kept) < length(way) + 1e-9


@pytest.mark.parametrize("count", range(6))
def test_along_a_way_of_a_few_points_there_is_no_line(count):
    way = [(1.0 + 0.1 * i, 1.0) for i in range(count + 1)]
    _, lines = lines_in(Room(4.0, 2.0), way[:count] or way[:1], (1.0, 1.0, 0.0))
    assert lines == []


@pytest.mark.parametrize(
    ("vertices", "pose"),
    [
        ([(1.0, 1.0), (7.0, 1.0), (7.0, 7.0)], (1.0, 0.8, 0.2)),
        ([(2.0, 0.6), (6.0, 1.4), (7.2, 6.0)], (2.0, 0.6, -0.3)),
    ],
)
def test_the_mirror_image_of_a_map_has_the_mirror_image_of_the_line(vertices, pose):
    plain, other = corner(), corner()
    other.cells = other.cells[::-1].copy()
    # The room reaches from 0 to 8 m.
    sign, shift = np.array([1.0, -1.0]), np.array([0.0, 8.0])
    _, line = line_in(plain, vertices, pose)
    there = (pose[0], 8.0 - pose[1], -pose[2])
    _, image = line_in(other, np.array(vertices) * sign + shift, there)
    assert image == pytest.approx(line * sign + shift, abs=1e-5)


@given(radius=st.floats(0.8, 50.0), sign=st.sampled_from([-1, 1]), count=st.integers(3, 60))
def test_on_a_circle_the_curvature_is_one_over_its_radius(radius, sign, count):
    angles = sign * np.arange(count) * POINT_SPACING / radius
    points = radius * np.column_stack([np.cos(angles), np.sin(angles)]) + (3.0, -2.0)
    assert curvatures(points) == pytest.approx(np.full(count, sign / radius), rel=1e-4)


def test_a_straight_line_has_no_curvature():
    points = np.column_stack([np.linspace(0, 3, 31), np.linspace(1, -4, 31)])
    assert curvatures(points) == pytest.approx(np.zeros(31), abs=1e-9)


@given(angle=st.floats(1.6, math.pi), on=st.floats(0.02, 0.3), back=st.floats(0.02, 0.3))
def test_a_line_that_turns_back_is_tighter_than_any_car_can_steer(angle, on, back):
    points = np.array(
        [(0.0, 0.0), (on, 0.0), (on + back * math.cos(angle), back * math.sin(angle))]
    )
    assert np.abs(curvatures(points)).max() > 2 * CAR.max_curvature


@st.composite
def curves(draw):
    """Polylines whose curvature wanders within what the car can steer."""
    bends = draw(st.lists(st.floats(-1.25, 1.25), min_size=2, max_size=12))
    kappa = np.repeat(bends, 8)
    yaw = np.cumsum(kappa * POINT_SPACING)
    steps = POINT_SPACING * np.column_stack([np.cos(yaw), np.sin(yaw)])
    return np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)])


@given(curves(), st.floats(0.0, 4.0))
def test_no_speed_breaks_a_limit_of_the_car(points, start):
    v_max, accel, braking, lateral, _ = LIMITS
    v = speeds(points, start, LIMITS)
    assert (v <= v_max + 1e-9).all()
    assert v[0] <= start + 1e-9
    assert (v**2 * np.abs(curvatures(points)) <= lateral + 1e-9).all()
    steps = np.hypot(*np.diff(points, axis=0).T)
    a = np.diff(v**2) / (2 * steps)
    assert (a <= accel + 1e-9).all()
    assert (a >= -braking - 1e-9).all()


@given(curves(), st.floats(0.0, 4.0))
def test_no_speed_could_be_higher(points, start):
    v_max, accel, braking, lateral, _ = LIMITS
    square = speeds(points, start, LIMITS) ** 2
    steps = np.hypot(*np.diff(points, axis=0).T)
    cap = np.minimum(v_max**2, lateral / np.maximum(np.abs(curvatures(points)), 1e-9))
    cap[0] = min(cap[0], start**2)
    cap[1:] = np.minimum(cap[1:], square[:-1] + 2 * accel * steps)
    cap[:-1] = np.minimum(cap[:-1], square[1:] + 2 * braking * steps)
    assert square == pytest.approx(cap, abs=1e-9)


@given(start=st.floats(0.3, 4.0), metres=st.floats(1.0, 30.0))
def test_a_straight_takes_as_long_as_mechanics_says(start, metres):
    points = np.column_stack([np.linspace(0.0, metres, 301), np.zeros(301)])
    rising = (CAR.v_max**2 - start**2) / (2 * CAR.acceleration)
    if metres <= rising:
        end = math.sqrt(start**2 + 2 * CAR.acceleration * metres)
        expected = (end - start) / CAR.acceleration
    else:
        expected = (CAR.v_max - start) / CAR.acceleration + (metres - rising) / CAR.v_max
    # In the step in which top speed is reached the mean of two speeds is not quite the speed's.
    assert seconds(points, start) == pytest.approx(expected, rel=3e-3)


@given(curves(), st.floats(0.3, 4.0))
def test_a_line_takes_as_long_one_way_as_its_mirror_image(points, start):
    mirrored = points * (1.0, -1.0)
    assert seconds(mirrored, start) == pytest.approx(seconds(points, start), rel=1e-9)
