"""Observation with errors: what counts as free is free, wherever in their bounds the errors lie."""

import dataclasses
import math

import numpy as np
import pytest

from foresee.mapping.error_bounds import ErrorBounds
from foresee.mapping.grid import OccupancyGrid, mark_beams, mark_sure
from sim import Lidar, LidarConfig, empty_straight, generate, sample_task

BOUNDS = ErrorBounds(position=0.05, yaw=math.radians(1.0), range=0.03)


def scanned(world, pose, lidar, rng, bounds):
    """Return marks of a scan whose errors lie on the edge of their bounds."""
    scan = lidar.scan(world, pose, rng)
    bearing = rng.uniform(-math.pi, math.pi)
    seems = np.add(
        pose,
        [
            bounds.position * math.cos(bearing),
            bounds.position * math.sin(bearing),
            rng.choice([-1, 1]) * bounds.yaw,
        ],
    )
    scan.ranges[:] += rng.choice([-1, 1]) * bounds.range
    frame = world.grid.frame.square(seems[0], seems[1], 5.0)
    return frame, mark_sure(scan, tuple(seems), frame, bounds)


@pytest.mark.parametrize("family", ["corridor", "narrow", "office", "obstacle_field"])
@pytest.mark.parametrize("dropout", [0.0, 0.1])
def test_no_solid_cell_is_observed_free_whatever_the_errors(family, dropout):
    rng = np.random.default_rng(0)
    lidar = Lidar(LidarConfig(dropout=dropout))
    marked = 0
    for seed in range(3):
        world = generate(family, seed)
        task = sample_task(world, seed, min_length=10.0)
        ways = np.vstack([task.start[:2], task.waypoints])
        for x, y in ways:
            pose = (x, y, rng.uniform(-math.pi, math.pi))
            frame, marks = scanned(world, pose, lidar, rng, BOUNDS)
            solid = world.grid.crop(frame).cells != 0
            assert not (solid & (marks == 1)).any()
            marked += (marks == 1).sum()
    # It is not vacuous: about as much is observed as with exact beams.
    assert marked > 1000


def test_larger_bounds_show_less():
    world = empty_straight(20.0, 3.0)
    frame = world.grid.frame
    scan = Lidar().scan(world, (8.0, 1.6, 0.1))
    pose = (8.0, 1.6, 0.1)
    exact = mark_beams(scan, pose, frame) == 1
    last = exact
    for size in (0.0, 0.02, 0.05, 0.1):
        bounds = ErrorBounds(position=size, yaw=0.1 * size)
        free = mark_sure(scan, pose, frame, bounds) == 1
        assert free.any()
        assert not (free & ~last).any()
        last = free


def test_a_beam_without_a_measurement_hides_little_and_many_hide_what_is_far():
    world = empty_straight(20.0, 3.0)
    frame, pose = world.grid.frame.square(8.0, 1.6, 5.0), (8.0, 1.6, 0.0)
    scan = Lidar().scan(world, pose)
    whole = mark_sure(scan, pose, frame, BOUNDS) == 1
    scan.ranges[::2] = np.nan
    every_second = mark_sure(scan, pose, frame, BOUNDS) == 1
    assert every_second.sum() > 0.9 * whole.sum()
    scan.ranges[300:700] = np.nan
    ahead = frame.cell(10.0, 1.6)
    assert whole[ahead]
    assert not (mark_sure(scan, pose, frame, BOUNDS) == 1)[ahead]


def test_a_scan_of_the_full_circle_has_no_seam():
    world = empty_straight(20.0, 3.0)
    frame = world.grid.frame
    scan = Lidar(LidarConfig(fov=2 * math.pi, beams=1440)).scan(world, (8.0, 1.6, 0.0))
    free = mark_sure(scan, (8.0, 1.6, 0.0), frame, BOUNDS) == 1
    assert free[frame.cell(6.0, 1.6)]
    assert free[frame.cell(10.0, 1.6)]


@pytest.mark.parametrize("more", [1, 5, 90])
def test_beams_that_repeat_the_first_ones_change_nothing(more):
    world, pose = empty_straight(20.0, 3.0), (8.0, 1.6, 0.3)
    scan = Lidar(LidarConfig(fov=2 * math.pi, beams=360)).scan(world, pose)
    longer = dataclasses.replace(scan, ranges=np.concatenate([scan.ranges, scan.ranges[:more]]))
    marks = [mark_sure(one, pose, world.grid.frame, BOUNDS) for one in (scan, longer)]
    assert np.array_equal(*marks)
    assert (marks[0] == 1).any()


def test_a_grid_without_errors_is_integrated_as_before():
    world = empty_straight(20.0, 3.0)
    scan = Lidar().scan(world, (8.0, 1.6, 0.1))
    grids = [OccupancyGrid(world.grid.frame, 5.0) for _ in range(2)]
    grids[0].integrate(scan, (8.0, 1.6, 0.1))
    grids[1].integrate(scan, (8.0, 1.6, 0.1), ErrorBounds(delay=0.2, lag=0.1))
    assert (grids[0].log_odds == grids[1].log_odds).all()
    grids[1].integrate(scan, (8.0, 1.6, 0.1), BOUNDS)
    assert (grids[0].log_odds != grids[1].log_odds).any()


@pytest.mark.parametrize("name", ["delay", "jitter", "lag", "position", "yaw", "range"])
@pytest.mark.parametrize("value", [-0.1, math.inf, math.nan])
def test_a_bound_is_finite_and_not_negative(name, value):
    with pytest.raises(ValueError, match=name):
        ErrorBounds(**{name: value})
