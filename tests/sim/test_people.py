"""People walk where there is room, keep away from the robot, and do it again."""

import numpy as np
import pytest

from sim.families import generate
from sim.people import APART, RADIUS, SPEEDS, People

FAR = np.array([1e3, 1e3])


@pytest.fixture(scope="module")
def world():
    return generate("office", 3)


def walked(world, seed, ticks=200):
    crowd = People(world, 0.05, FAR, np.random.default_rng(seed))
    places = [crowd.places]
    for _ in range(ticks):
        crowd.walk(0.1, FAR)
        places.append(crowd.places)
    return np.array(places)


def test_there_are_as_many_as_asked_for(world):
    floor = world.grid.free.sum() * world.grid.frame.resolution**2
    counts = [len(People(world, 0.05, FAR, np.random.default_rng(s)).places) for s in range(50)]
    assert np.mean(counts) == pytest.approx(0.05 * floor, rel=0.1)
    assert len(People(world, 0.0, FAR, np.random.default_rng(0)).discs) == 0


def test_they_walk_on_free_floor_and_no_faster_than_they_can(world):
    places = walked(world, 1)
    frame = world.grid.frame
    cells = np.floor((places - np.array(frame.origin)) / frame.resolution).astype(int)
    assert (world.clearance[cells[..., 1], cells[..., 0]] > RADIUS).all()
    speeds = np.hypot(*np.moveaxis(np.diff(places, axis=0), -1, 0)) / 0.1
    assert speeds.max() <= SPEEDS[1] + 1e-9
    assert (speeds > SPEEDS[0] - 1e-9).mean() > 0.5


def test_they_come_no_nearer_to_the_robot(world):
    robot = People(world, 0.3, FAR, np.random.default_rng(2)).places[0]
    crowd = People(world, 0.3, robot, np.random.default_rng(2))
    nearest = []
    for _ in range(100):
        nearest.append(np.hypot(*(crowd.places - robot).T).min())
        crowd.walk(0.1, robot)
    assert APART < min(nearest) < 1.5 * APART


def test_the_same_seed_gives_the_same_walk(world):
    assert np.array_equal(walked(world, 4), walked(world, 4))
    assert not np.array_equal(walked(world, 4), walked(world, 5))
