"""What is counted was done, and what is called exact is compared with the exact answer."""

import math

import numpy as np
import pytest

from benchmarks.studies.performance import rates
from benchmarks.studies.performance import sized_maps as places
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN
from sim import Lidar, LidarConfig
from sim.buildings import task_in


def test_exact_ranges_are_those_of_geometry():
    cells = np.full((30, 40), FREE, np.int8)
    cells[:, [0, -1]] = cells[[0, -1]] = OCCUPIED
    cells[20] = UNKNOWN
    angles = np.array([0.0, math.pi, -math.pi / 2, math.pi / 2, math.pi / 6])
    got = rates.exact_ranges(cells, 10.3, 10.6, angles, 25.0)
    assert got[:3] == pytest.approx([math.inf, 9.3, 9.6])
    assert math.isnan(got[3])
    assert math.isnan(got[4])
    assert rates.exact_ranges(cells, 10.3, 10.6, angles[:1], 40.0)[0] == pytest.approx(28.7)
    assert all(math.isnan(r) for r in rates.exact_ranges(cells, 0.5, 0.5, angles, 25.0))
    diagonal = np.array([math.pi / 4])
    cells[13, 14] = OCCUPIED
    assert rates.exact_ranges(cells, 10.0, 10.0, diagonal, 25.0) == [None]


def test_the_lidar_is_exact_and_one_that_is_not_is_found_out(monkeypatch):
    world = places.cluttered(500, 1)
    poses = places.anywhere(world, 5)
    worst, compared = rates.error(Lidar(), world, poses)
    assert worst < 1e-9
    assert compared > 200
    monkeypatch.setattr("sim.lidar.cast_rays", shifted(1e-6, None))
    assert 1e-9 < rates.error(Lidar(), world, poses)[0] < 1e-6
    monkeypatch.setattr("sim.lidar.cast_rays", shifted(0.0, math.inf))
    assert rates.error(Lidar(), world, poses)[0] == math.inf


def shifted(by, instead):
    from sim.lidar import cast_rays

    def cast(*args):
        ranges = cast_rays(*args) + by
        if instead is not None:
            ranges[np.isfinite(ranges)] = instead
        return ranges

    return cast


def test_maps_have_the_size_that_their_names_say_and_poses_lie_in_free_space():
    world = places.corridors(task_in("corridor", 0), 1000)
    assert world.grid.cells.shape == (1000, 1000)
    for pose in places.anywhere(world, 50):
        assert world.grid.free[world.grid.frame.cell(*pose[:2])]


def test_poses_on_ways_are_ticks_apart_and_pass_no_wall():
    world = places.cluttered(500, 1)
    poses = places.on_ways(world, 300)
    assert poses.shape == (300, 3)
    for pose in poses:
        assert world.clearance[world.grid.frame.cell(*pose[:2])] >= places.CLEAR
    far = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    same_way = np.diff(poses[:, 2]) == 0.0
    assert far[same_way] == pytest.approx(places.STEP)
    assert 0.8 < same_way.mean() < 1.0


def test_rays_are_counted_on_ways_and_from_fresh_places(monkeypatch):
    monkeypatch.setattr(rates, "maps", lambda seed: {"a": places.cluttered(200, 0)})
    for name, few in (("SCANS", 30), ("ROUNDS", 3), ("CHECKED_POSES", 2), ("CHECKED_BEAMS", 9)):
        monkeypatch.setattr(rates, name, few)
    found = rates.rays(0)
    assert list(found) == [
        "rays, on ways, a, 1 thread",
        "rays, on ways, a, 2 threads",
        "rays, fresh places, a, 1 thread",
        "rays, fresh places, a, 2 threads",
        "rays, a, largest error",
    ]
    assert found["rays, fresh places, a, 2 threads"]["samples"] == 2 * 30 * 1081 * 3


def test_no_beam_is_cut_short_of_its_range_in_mapping(monkeypatch):
    monkeypatch.setattr(rates, "REPEATS", 3)
    world = places.cluttered(900, 0)
    monkeypatch.setattr(rates, "maps", lambda seed: {"a": world})
    grids = []
    made = rates.OccupancyGrid

    def kept(*args):
        grids.append(made(*args))
        return grids[-1]

    monkeypatch.setattr(rates, "OccupancyGrid", kept)
    found = rates.mapping(0)["mapping, a"]
    assert found["value"] > 0
    assert found["unit"] == "scans/s"
    config = LidarConfig()
    assert grids[0].window >= 2 * (config.range_max + abs(config.mount[0]))
    assert (grids[0].log_odds != 0).any()
