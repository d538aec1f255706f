"""The suites of the race are what they were, and a building that is another is refused."""

from dataclasses import replace

import numpy as np
import pytest

import sim.suite
from foresee.mapping.family_names import FAMILIES
from foresee.mapping.grid import Grid
from sim.families import generate
from sim.suite import SMALL, Suite, SuiteError, suites
from sim.world import World


def test_the_suites_use_seeds_of_their_own():
    seeds = [place.seed for name in suites() for place in Suite.read(name).places]
    assert len(set(seeds)) == len(seeds) == 60 * len(suites())
    # Training, calibrations and published results use others; files hold no larger numbers.
    assert 900_000_000 <= min(seeds) <= max(seeds) < 910_000_000


@pytest.mark.parametrize("name", suites())
def test_this_version_draws_the_first_building_of_a_suite(name):
    suite = Suite.read(name)
    task = suite.task(0)
    assert task.goal == pytest.approx(suite.places[0].goal, abs=1e-6)
    assert {place.family for place in suite.places} <= set(FAMILIES)


def test_the_small_size_of_the_mixture_has_all_of_its_families():
    places = Suite.read("mixed-v1").places
    assert {p.family for p in places[:SMALL]} == {p.family for p in places}


def test_a_building_that_is_another_in_one_cell_is_refused(monkeypatch):
    def edited(family, seed):
        world = generate(family, seed)
        cells = world.grid.cells.copy()
        cells[0, 0] = np.int8(0)
        return World(world.name, Grid(world.grid.frame, cells))

    monkeypatch.setattr(sim.suite, "generate", edited)
    with pytest.raises(SuiteError, match=r"building 0 .* draws another map than the suite has"):
        Suite.read("corridor-v1").task(0)


@pytest.mark.parametrize("fact", ["start", "goal", "length"])
def test_a_task_that_is_another_is_refused(fact):
    suite = Suite.read("corridor-v1")
    place = suite.places[0]
    moved = {
        "start": (place.start[0] + 0.05, *place.start[1:]),
        "goal": (place.goal[0], place.goal[1] - 0.05),
        "length": place.length + 0.05,
    }
    other = replace(suite, places=(replace(place, **{fact: moved[fact]}),))
    with pytest.raises(SuiteError, match=f"draws another {fact} than the suite has"):
        other.task(0)


@pytest.mark.parametrize("index", [-1, 60])
def test_a_building_that_a_suite_does_not_have_is_refused(index):
    with pytest.raises(SuiteError, match=r"has no building .*, only 0 to 59"):
        Suite.read("corridor-v1").task(index)


def test_a_suite_that_does_not_exist_is_refused():
    with pytest.raises(SuiteError, match="no suite is called 'corridor-v9'; there are corridor-v1"):
        Suite.read("corridor-v9")
