import numpy as np
import pytest

from foresee.mapping.grid import OCCUPIED, Grid
from sim.building_statistics import STATISTICS, building_statistics
from sim.canvas import Canvas
from sim.families import empty_straight
from sim.world import World


def statistics(world):
    return building_statistics(world, np.random.default_rng(0))


def test_a_straight_corridor_has_its_known_numbers():
    numbers = statistics(empty_straight(40.0, 4.0))
    assert numbers.keys() == STATISTICS.keys()
    assert numbers["extent"] == pytest.approx(40.0)
    assert numbers["area"] == pytest.approx(160.0)
    assert numbers["filled"] == pytest.approx(1.0)
    # The distance to the nearest of two walls is uniform from 0 to 2 m, but for the ends.
    quartiles = [numbers[f"clearance{of}"] for of in ("_low", "", "_high")]
    assert quartiles == pytest.approx([0.5, 1.0, 1.5], abs=0.1)
    assert numbers["rooms"] == pytest.approx(100 / 160)
    assert numbers["walls"] == pytest.approx(88 / 160 * np.pi / 4)
    assert numbers["small"] == 0.0
    # A ray at an angle a to the axis reaches the wall after about 2 m / sin a.
    assert 2.0 < numbers["sight"] < 3.5
    assert numbers["sight_low"] < numbers["sight"] < numbers["sight_high"] <= 20.0


def test_doors_separate_rooms_and_only_small_obstacles_count_as_small():
    canvas = Canvas(22.0, 12.0)
    canvas.room((1.0, 1.0), (10.9, 11.0))
    canvas.room((11.1, 1.0), (21.0, 11.0))
    canvas.passage((10.0, 6.0), (12.0, 6.0), 1.0)
    canvas.box((5.0, 5.0), (0.2, 0.2))
    canvas.box((15.0, 4.0), (0.5, 0.5))
    canvas.box((15.0, 8.0), (2.0, 1.0))
    numbers = statistics(canvas.world("two rooms"))
    assert numbers["rooms"] * numbers["area"] / 100 == pytest.approx(2)
    assert numbers["small"] * numbers["area"] / 100 == pytest.approx(2)


def test_space_that_is_not_connected_is_left_out():
    canvas = Canvas(22.0, 12.0)
    canvas.room((1.0, 1.0), (10.0, 11.0))
    canvas.room((12.0, 1.0), (18.0, 11.0))
    assert statistics(canvas.world("two"))["area"] == pytest.approx(90.0)


def test_a_building_without_free_space_is_refused():
    frame = Canvas(3.0, 3.0).frame
    with pytest.raises(ValueError, match="no free space"):
        statistics(World("solid", Grid(frame, np.full(frame.shape, OCCUPIED, np.int8))))
