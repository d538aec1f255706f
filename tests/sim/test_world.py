import numpy as np
import pytest

from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from sim.world import World, empty_squares


def random_world(seed: int) -> World:
    rng = np.random.default_rng(seed)
    cells = rng.choice(np.array([FREE, OCCUPIED, UNKNOWN], np.int8), (14, 19), p=[0.9, 0.05, 0.05])
    return World("random", Grid(GridFrame(0.1, (0.0, 0.0), cells.shape), cells))


def test_all_that_is_not_free_is_solid():
    world = random_world(0)
    assert np.array_equal(world.solid, ~world.grid.free)


@pytest.mark.parametrize("seed", range(3))
def test_each_empty_square_is_the_largest_one_in_its_quadrant(seed):
    world = random_world(seed)
    solid = np.pad(world.solid, 1, constant_values=True)
    skips = empty_squares(world.solid)
    for quadrant, (dx, dy) in enumerate([(1, 1), (-1, 1), (1, -1), (-1, -1)]):
        oriented, sides = solid[::dy, ::dx], skips[quadrant][::dy, ::dx]
        for row, col in np.ndindex(solid.shape):
            side = sides[row, col]
            assert not oriented[row : row + side, col : col + side].any()
            assert oriented[row : row + side + 1, col : col + side + 1].any()


def test_clearance_counts_the_edge_of_the_map_as_solid():
    cells = np.full((5, 9), FREE, np.int8)
    world = World("open", Grid(GridFrame(0.1, (0, 0), cells.shape), cells))
    assert world.clearance[2, 4] == pytest.approx(0.3)
    assert world.clearance[0, 0] == pytest.approx(0.1)
