import math

import numpy as np
import pytest

from foresee.mapping.body import Body
from foresee.mapping.car_limits import CONTACT_MARGIN, CarLimits
from foresee.mapping.family_names import FAMILIES
from foresee.mapping.grid import FREE, OCCUPIED, Grid, GridFrame, OccupancyGrid, mark_beams
from planner.navigator import Navigator
from planner.navigator_config import NavigatorConfig
from sim.arc_search import HEADINGS, search_arcs
from sim.car import along_arc, collides
from sim.families import empty_straight, generate
from sim.lidar import Lidar
from sim.task import (
    NEW,
    NO_TRIP,
    SLACK,
    START_CLEARANCE,
    START_MARGINS,
    NoTaskError,
    Task,
    prolonged,
    sample_task,
)
from sim.world import World

CAR = CarLimits()
CASES = [(family, seed) for family in FAMILIES for seed in range(4)]


@pytest.mark.parametrize(("family", "seed"), CASES)
def test_every_family_gives_tasks_that_are_far_and_begin_and_end_in_the_open(family, seed):
    world = generate(family, seed)
    task = sample_task(world, seed, CAR)
    assert 20.0 <= task.path_length <= 80.0
    assert tuple(task.waypoints[-1]) == task.goal
    assert not collides(world, task.start, CAR.body.inflated(START_CLEARANCE))
    for yaw in np.linspace(-math.pi, math.pi, 16):
        assert not collides(world, (*task.goal, yaw), CAR.body)
    points = np.vstack([task.start[:2], task.waypoints])
    gaps = np.hypot(*np.diff(points, axis=0).T)
    assert gaps.max() < 2.1
    # A car that goes 0.35 m an arc cuts no corner: the way is as long as its waypoints say.
    assert 0.75 * task.path_length < gaps.sum() <= task.path_length + 1e-9


def test_a_corridor_network_has_a_way_of_thirty_metres():
    for seed in range(6):
        assert sample_task(generate("corridor", seed), seed, CAR, min_length=30.0)


def test_the_same_seed_gives_the_same_task_and_another_another():
    world = generate("trap", 3)
    first, again, other = (sample_task(world, seed, CAR) for seed in (1, 1, 2))
    assert first.start == again.start
    assert first.goal == again.goal
    assert np.array_equal(first.waypoints, again.waypoints)
    assert first.start != other.start


CORRIDOR_TASKS = (
    (39.575, 36.975, 1.499, 13.922, 30.119, 60.821),
    (36.025, 23.875, -2.471, 18.638, 33.678, 43.197),
    (15.225, 35.125, -2.641, 48.841, 24.16, 39.741),
    (7.325, 27.925, -1.654, 32.527, 6.74, 40.087),
    (51.125, 31.325, -1.107, 35.415, 32.509, 77.409),
    (43.225, 40.075, 0.953, 9.017, 15.844, 63.931),
    (10.175, 19.825, -0.396, 19.178, 2.942, 29.374),
    (24.675, 50.025, -2.806, 19.569, 15.783, 58.402),
    (40.575, 20.975, 1.687, 28.595, 3.241, 31.102),
    (38.375, 24.175, -1.732, 12.829, 33.753, 52.527),
    (19.925, 34.425, -0.07, 54.083, 18.023, 45.27),
    (41.175, 14.475, 2.941, 6.72, 40.512, 58.057),
)
"""Start x, y, yaw, goal x, y, and length of the way of seeds 0 to 11, as they were published."""


@pytest.mark.slow(6)
def test_the_tasks_of_published_drives_stay_what_they_were():
    for seed, expected in enumerate(CORRIDOR_TASKS):
        task = sample_task(generate("corridor", seed), seed, CAR)
        assert (*task.start, *task.goal, task.path_length) == pytest.approx(expected, abs=6e-4)


def test_a_goal_beside_the_start_is_drawn_again():
    # A ring, closed by a wall: the way around it may lead to the start's other side.
    cells = np.full((220, 220), FREE, np.int8)
    cells[:4], cells[-4:], cells[:, :4], cells[:, -4:] = (OCCUPIED,) * 4
    cells[60:160, 60:160] = cells[108:112, 160:] = OCCUPIED
    ring = World("ring", Grid(GridFrame(0.05, (0, 0), cells.shape), cells))
    for seed in range(2):
        task = sample_task(ring, seed, CAR, min_length=20.0)
        assert math.dist(task.start[:2], task.goal) >= NO_TRIP


def a_task(*waypoints):
    points = np.array(waypoints, dtype=float)
    return Task(empty_straight(60.0, 4.0), (0.0, 0.0, 0.0), tuple(points[-1]), points, 30.0, 0)


def test_a_way_that_passes_a_place_twice_comes_back():
    assert not a_task((20, 0)).comes_back
    loop = ((10, 0), (10, 5), (6, 5), (6, -5))
    assert a_task(*loop).comes_back
    # Two parts of a way on both sides of a wall.
    assert not a_task((10, 0), (10, 0.6), (0, 0.6)).comes_back
    assert a_task((10, 0), (10, 0.4), (0, 0.4)).comes_back
    # A car that starts in the wrong direction turns round.
    assert not a_task((2, 0), (2, 1), (0, 1), (0, 0), (-20, 0)).comes_back


@pytest.mark.parametrize(
    ("body", "turning_radius", "family", "seed"),
    [
        (Body(), CAR.turning_radius, "narrow", 5),
        (Body(0.9, 0.3), CAR.turning_radius, "narrow", 5),
        (Body(0.3, 0.3), CAR.turning_radius, "narrow", 5),
        (Body(), 12.0, "office", 3),
    ],
)
def test_every_way_that_is_found_can_be_driven_without_a_collision(
    body, turning_radius, family, seed
):
    world = generate(family, seed)
    frame = world.grid.frame
    row, col = np.unravel_index(np.argmax(world.clearance), frame.shape)
    start = (*frame.centre(int(row), int(col)), 0.3)
    radius = SLACK * turning_radius
    poses, parents, arcs, first = search_arcs(world, start, body, radius, 0.05, 0.4, 40.0)
    assert parents[0] == -1
    assert first[0]
    length = radius * 2 * math.pi / HEADINGS
    rng = np.random.default_rng(0)
    nodes = np.arange(1, len(poses))
    for node in rng.choice(nodes, min(400, len(nodes)), replace=False):
        parent = parents[node]
        assert arcs[node] == arcs[parent] + 1
        turn = poses[node, 2] - poses[parent, 2]
        way = [along_arc(*poses[parent], turn / length, s) for s in np.linspace(0, length, 40)]
        assert np.allclose(way[-1][:2], poses[node, :2], atol=1e-9)
        assert not collides(world, way, body, 0.02)


def test_circles_cover_the_body():
    for body in (Body(), Body(1.3, 0.2), Body(0.2, 0.7)):
        offsets, radius = body.circles()
        x = np.linspace(-body.half_length, body.half_length, 50)
        y = np.linspace(-body.half_width, body.half_width, 50)
        distance = np.hypot(x[:, None, None] - offsets, y[None, :, None]).min(axis=2)
        assert distance.max() <= radius + 1e-9


def test_a_straight_leads_from_one_end_towards_the_other():
    task = sample_task(empty_straight(60.0, 4.0), 0, CAR)
    assert abs(task.goal[0] - task.start[0]) == pytest.approx(task.path_length, rel=0.15)


def test_a_drive_can_be_prolonged_over_more_goals():
    world = generate("paper", 1)
    task = sample_task(world, 1, CAR)
    longer, again = (prolonged(task, task.path_length + 90.0, CAR) for _ in range(2))
    assert longer.path_length >= task.path_length + 90.0
    assert np.array_equal(longer.waypoints, again.waypoints)
    assert np.array_equal(longer.waypoints[: len(task.waypoints)], task.waypoints)
    assert longer.start == task.start
    assert tuple(longer.waypoints[-1]) == longer.goal
    gaps = np.hypot(*np.diff(np.vstack([task.start[:2], longer.waypoints]), axis=0).T)
    assert gaps.max() < 2.1
    assert 0.75 * longer.path_length < gaps.sum() <= longer.path_length + 1e-6
    # Some of it is new ground.
    ahead = longer.waypoints[len(task.waypoints) :]
    apart = np.linalg.norm(ahead[:, None] - task.waypoints, axis=2).min(axis=1)
    assert apart.max() > NEW
    assert np.array_equal(prolonged(task, 1.0, CAR).waypoints, task.waypoints)


def test_a_drive_that_cannot_go_on_says_so():
    world = empty_straight(24.0, 1.6)
    task = sample_task(world, 0, CAR, min_length=12.0)
    with pytest.raises(NoTaskError, match="there is no going on"):
        prolonged(task, 200.0, CAR)


def test_a_world_without_a_way_says_so():
    cells = np.full((60, 60), FREE, np.int8)
    cells[:, [0, -1]] = cells[[0, -1], :] = OCCUPIED
    room = World("room", Grid(GridFrame(0.05, (0, 0), cells.shape), cells))
    with pytest.raises(NoTaskError, match=r"room: no way of 20 to 80 m"):
        sample_task(room, 0, CAR)
    solid = World("solid", Grid(room.grid.frame, np.full((60, 60), OCCUPIED, np.int8)))
    with pytest.raises(NoTaskError):
        sample_task(solid, 0, CAR)
    with pytest.raises(ValueError, match="min_length"):
        sample_task(room, 0, CAR, min_length=9, max_length=3)


@pytest.mark.parametrize("family", FAMILIES)
def test_the_space_that_a_driver_is_told_to_be_free_at_the_start_is_free(family):
    for seed in range(3):
        try:
            task = sample_task(generate(family, seed), seed, min_length=10.0)
        except NoTaskError:
            continue
        truth, window = task.world.grid, 5.0
        margin = task.start_margin(CAR.body)
        assert 0.2 <= margin <= START_MARGINS[0]
        known = task.blank(window)
        known.mark_free(task.start, CAR.body, margin)
        told = known.crop(truth.frame).free
        assert told.any()
        assert not (told & task.world.solid).any()


@pytest.mark.parametrize("gap", [0.03, 0.06, 0.12])
def test_a_start_close_to_a_wall_leaves_the_driver_room_to_stand(gap):
    world = empty_straight(20.0, 2.0)
    frame = world.grid.frame
    wall = frame.origin[1] + frame.resolution * np.argwhere(world.grid.free)[:, 0].min()
    y = wall + CAR.body.half_width + gap
    task = Task(world, (5.0, y, 0.0), (15.0, y), np.array([[15.0, y]]), 10.0, seed=0)
    margin = task.start_margin(CAR.body)
    assert CONTACT_MARGIN < margin <= gap
    config, known = NavigatorConfig(start_margin=margin), task.blank(5.0)
    driver = Navigator(config, None, np.array(task.start), task.goal, known)
    decision = driver.step(np.array([*task.start, 0.0]), Lidar().scan(world, task.start))
    assert not decision.emergency


def test_what_the_lidar_sees_overrules_what_was_assumed_of_the_start():
    world = empty_straight(20.0, 1.0)
    frame, pose = world.grid.frame, (3.0, 1.0, 0.0)
    known = OccupancyGrid(frame, 5.0)
    known.mark_free(pose, CAR.body, 0.8)
    assumed = known.crop(frame).free & world.solid
    scan = Lidar().scan(world, pose)
    known.integrate(scan, pose)
    hits = assumed & (mark_beams(scan, pose, frame) == 2)
    assert hits.any()
    assert known.crop(frame).occupied[hits].all()
