"""What is counted was done."""

import numpy as np
import pytest

from benchmarks.studies.performance import rates
from benchmarks.studies.performance import sized_maps as places
from sim import LidarConfig
from sim.buildings import task_in


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
    assert far[same_way] == pytest.approx(places.PER_TICK)
    assert 0.8 < same_way.mean() < 1.0


def test_rays_are_counted_on_ways_and_from_fresh_places(monkeypatch):
    monkeypatch.setattr(rates, "maps", lambda seed: {"a": places.cluttered(200, 0)})
    for name, few in (("SCANS", 30), ("ROUNDS", 3)):
        monkeypatch.setattr(rates, name, few)
    found = rates.rays(0)
    assert list(found) == [
        "rays, on ways, a, 1 thread",
        "rays, on ways, a, 2 threads",
        "rays, fresh places, a, 1 thread",
        "rays, fresh places, a, 2 threads",
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
