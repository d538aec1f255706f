"""What the car will have seen from a place, if the predictions are true."""

import numpy as np
import pytest

from planner.safety.foresight import reveal

SHAPE, RESOLUTION, ORIGIN = (80, 100), 0.05, (-1.0, -2.0)


def revealed(barred, safe, x, y, half=1.5, certain=None):
    certain = np.zeros(SHAPE, dtype=bool) if certain is None else certain.copy()
    reveal(certain, barred, safe, RESOLUTION, ORIGIN, x, y, half)
    return certain


def nothing():
    return np.zeros(SHAPE, dtype=bool)


def test_in_the_open_all_of_the_window_is_seen_and_nothing_else():
    seen = revealed(nothing(), ~nothing(), 1.0, 0.0)
    rows, cols = np.nonzero(seen)
    x, y = ORIGIN[0] + RESOLUTION * (cols + 0.5), ORIGIN[1] + RESOLUTION * (rows + 0.5)
    inside = abs(x - 1.0).max(), abs(y - 0.0).max()
    assert max(inside) <= 1.5 + RESOLUTION
    # Without gaps, since each cell of the border has its ray.
    assert seen[12:68, 12:68].all()


def test_nothing_is_seen_behind_a_wall_and_something_through_its_door():
    wall = nothing()
    wall[:, 50] = True
    seen = revealed(wall, ~wall, 1.0, 0.0)
    assert not seen[:, 50:].any()
    assert seen[40, 45]
    wall[38:42, 50] = False
    through = revealed(wall, ~wall, 1.0, 0.0)
    assert through[40, 60]
    assert not through[60, 60]
    assert (through >= seen).all()


def test_only_cells_that_a_plan_may_enter_become_certain_and_none_is_lost():
    rng = np.random.default_rng(0)
    safe, certain = rng.random(SHAPE) < 0.5, rng.random(SHAPE) < 0.1
    seen = revealed(nothing(), safe, 1.0, 0.0, certain=certain)
    assert (seen[certain]).all()
    assert not (seen & ~safe & ~certain).any()


@pytest.mark.parametrize("place", [(-1.0, -2.0), (3.99, 1.99), (-5.0, 0.0), (20.0, 20.0)])
def test_a_place_at_the_edge_or_outside_of_the_grid_is_no_fault(place):
    seen = revealed(nothing(), ~nothing(), *place)
    assert seen.any() == (place[0] > -2.0 and place[0] < 10.0)
