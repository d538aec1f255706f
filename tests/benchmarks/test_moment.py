"""The moment of a drive, which a figure shows."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.runs.moment import EARLY_TICK, FEW_CELLS, Moment


def chosen(counts):
    """Return the tick that is kept of a drive that relies on so many cells in its ticks."""
    moment = Moment()
    for tick, count in enumerate(counts):
        moment.observe(tick, SimpleNamespace(relied=np.empty((count, 2))))
    return moment.tick


@pytest.mark.parametrize(
    ("counts", "tick"),
    [
        ([0, 5, 90, 90, 3], 2),
        ([0] * 60, EARLY_TICK),
        ([FEW_CELLS - 1, *[0] * 60], EARLY_TICK),
        ([FEW_CELLS, *[0] * 60], 0),
        ([*[0] * 50, 1, 0], 50),
        ([0] * 10, 0),
    ],
)
def test_the_moment_is_the_first_tick_that_relies_on_most_cells_or_else_an_early_one(counts, tick):
    assert chosen(counts) == tick


def test_a_drive_without_a_tick_has_no_moment():
    assert Moment().arrays() == {}
