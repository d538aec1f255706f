"""Variations on buildings keep what makes them buildings."""

import math

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, label

from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN
from sim.families import generate
from sim.variation import cluttered, turned, varied


@pytest.fixture(scope="module")
def office():
    return generate("office", 5)


def closed(world):
    """Whether nothing leads from free space to the unknown but through a wall."""
    free = np.pad(world.grid.cells == FREE, 1)
    wall = np.pad(world.grid.cells == OCCUPIED, 1)
    return not (binary_dilation(free, np.ones((3, 3))) & ~free & ~wall).any()


@pytest.mark.parametrize("angle", [0.3, -1.2, 2.5])
def test_a_turned_building_is_as_large_and_still_closed(office, angle):
    other = turned(office, angle)
    before, after = ((w.grid.cells == FREE).sum() for w in (office, other))
    assert after == pytest.approx(before, rel=0.01)
    assert closed(other)


def test_a_scaled_building_grows_in_both_directions(office):
    other = turned(office, 0.0, 1.2)
    before, after = ((w.grid.cells == FREE).sum() for w in (office, other))
    assert after == pytest.approx(1.44 * before, rel=0.03)
    assert closed(other)


def test_a_quarter_turn_moves_cells_and_changes_none(office):
    other = turned(office, math.pi / 2)
    rotated = np.rot90(office.grid.cells, -1)
    assert np.array_equal(other.grid.cells, rotated)


def test_clutter_stands_on_the_floor_and_not_in_walls(office):
    other = cluttered(office, 0.05, np.random.default_rng(0))
    changed = other.grid.cells != office.grid.cells
    assert (office.grid.cells[changed] == FREE).all()
    assert (other.grid.cells[changed] == OCCUPIED).all()
    assert label(changed)[1] > 10
    area = (office.grid.cells == FREE).sum() * 0.05**2
    assert 0.002 < changed.sum() * 0.05**2 / area < 0.06


def test_the_original_is_left_alone(office):
    before = office.grid.cells.copy()
    varied(office, np.random.default_rng(1))
    assert np.array_equal(office.grid.cells, before)


def test_the_same_seed_gives_the_same_variation(office):
    one, two = (varied(office, np.random.default_rng(7)) for _ in range(2))
    assert np.array_equal(one.grid.cells, two.grid.cells)


def test_no_cell_is_anything_else(office):
    for seed in range(4):
        cells = varied(office, np.random.default_rng(seed)).grid.cells
        assert set(np.unique(cells)) <= {FREE, OCCUPIED, UNKNOWN}
