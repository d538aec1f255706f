"""The scenarios of the attack: buildings, cars and starts, and what is said of the drives."""

import math

import numpy as np
import pytest

from benchmarks.studies.robustness.hostile_buildings import (
    MOST_CELLS,
    in_pocket,
    on_lattice,
    resampled,
    task_for,
    with_thin_walls,
)
from benchmarks.studies.robustness.hostile_drives import failures, table
from benchmarks.studies.robustness.scenario import (
    COARSEST,
    FINEST,
    ODDITIES,
    SITUATIONS,
    Scenario,
)
from benchmarks.studies.robustness.witness import Witness
from foresee.mapping.body import Scene, first_contact
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.conventions import TIGHTEST
from foresee.mapping.grid import FREE, OCCUPIED, OccupancyGrid
from sim import Lidar, empty_straight
from sim.families import generate
from sim.lidar import LidarConfig

CAR = CarLimits()


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def test_the_scenarios_cover_all_that_is_admitted():
    drawn = [Scenario.draw(index, 7) for index in range(1000)]
    assert {scenario.situation for scenario in drawn} == set(SITUATIONS)
    for oddity in ODDITIES:
        assert sum(scenario.odd == (oddity,) for scenario in drawn) > 50
    sides = [scenario.resolution for scenario in drawn if "cells" in scenario.odd]
    assert FINEST <= min(sides) < 0.012
    assert 0.4 < max(sides) <= COARSEST
    cars = [scenario.car for scenario in drawn if "body" in scenario.odd]
    shares = [car.body.radius / car.turning_radius for car in cars]
    assert 0.95 * TIGHTEST < max(shares) <= TIGHTEST
    assert min(shares) < 0.1
    assert all(s.car.reverse > 0 for s in drawn if "pocket" in s.odd)
    assert Scenario.draw(3, 7) == Scenario.draw(3, 7)


@pytest.mark.parametrize("resolution", [0.013, 0.03, 0.3])
def test_a_building_keeps_its_place_at_another_resolution(resolution, rng):
    world = generate("office", 3)
    other = resampled(world, resolution, rng)
    assert max(other.grid.frame.shape) <= MOST_CELLS
    assert other.grid.free.any()
    some = rng.choice(np.argwhere(other.grid.free), 500)
    points = np.array([other.grid.frame.centre(*cell) for cell in some])
    inside, rows, cols = world.grid.frame.locate(points)
    assert inside.all()
    assert world.grid.free[rows, cols].all()


def test_thin_walls_are_added_in_free_space_alone(rng):
    world = generate("office", 3)
    walled = with_thin_walls(world, rng).grid.cells
    changed = walled != world.grid.cells
    assert changed.sum() > 100
    assert (world.grid.cells[changed] == FREE).all()
    assert (walled[changed] == OCCUPIED).all()
    # No square of 2 × 2 cells, but where walls cross.
    squares = changed[1:, 1:] & changed[:-1, 1:] & changed[1:, :-1] & changed[:-1, :-1]
    assert squares.sum() < 0.01 * changed.sum()


@pytest.mark.parametrize("resolution", [0.02, 0.05, 0.5])
def test_a_pocket_can_be_left_in_reverse_alone(resolution, rng):
    world = resampled(generate("corridor", 2), resolution, rng)
    task = in_pocket(task_for(world, 1, CAR), CAR.body, rng)
    cos, sin = math.cos(task.start[2]), math.sin(task.start[2])

    def meets(along):
        pose = np.array([[task.start[0] + along * cos, task.start[1] + along * sin, task.start[2]]])
        scene = Scene(task.world.solid, *world.grid.frame.lattice, *CAR.body.halves)
        return first_contact(scene, pose) >= 0

    assert not meets(0.0)
    assert not any(map(meets, np.arange(0.0, -0.3, -0.01)))
    assert meets(0.5 + resolution)


def test_a_start_on_the_lattice_lies_in_the_corner_of_cells(rng):
    task = on_lattice(task_for(generate("corridor", 2), 1, CAR), CAR.body, rng)
    frame = task.world.grid.frame
    cells = (np.array(task.start[:2]) - frame.origin) / frame.resolution
    assert cells == pytest.approx(np.round(cells))
    assert task.start[2] % (0.25 * math.pi) == pytest.approx(0.0, abs=1e-9)


def test_a_witness_counts_what_is_observed_wrongly():
    world = empty_straight(20.0, 3.0)
    x, y = 6.0, 2.0
    known = OccupancyGrid(world.grid.frame, 5.0)
    known.integrate(Lidar().scan(world, (x, y, 0.0)), (x, y, 0.0))
    witness = Witness(world)
    witness.compare(known, x, y)
    assert not any(witness.false_cells.values())
    free, solid = (np.argwhere(cells) for cells in (known.whole().free, known.whole().occupied))
    known.log_odds[tuple(free[:3].T)] = 1
    known.log_odds[tuple(solid[0])] = -1
    witness.compare(known, x, y)
    assert witness.false_cells == {"solid_as_free": 1, "free_as_occupied": 3, "lost_free": 3}


def test_scans_from_corners_of_cells_are_true(rng):
    world = with_thin_walls(generate("office", 3), rng)
    witness = Witness(world)
    witness.scan_from_corners(Lidar(LidarConfig(fov=2 * math.pi, beams=1440, mount=(0, 0, 0))), rng)
    assert witness._free.sum() > 10_000
    assert not any(witness.false_cells.values())


GOOD = {
    **{"index": 3, "situation": "cells", "kind": "late", "outcome": "timed_out", "error": None},
    **{"touched": False, "false_cells": {"lost_free": 0}, "faults": {"predictor_late": 4}},
    **{"time": 5.0, "path_length": 10.0},
}


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"outcome": "collided"}, "collided"),
        ({"outcome": "crashed", "error": "E: x"}, "crashed E: x"),
        ({"touched": True}, "touched"),
        ({"false_cells": {"lost_free": 2}}, "lost_free 2"),
        ({"faults": {"emergency": 1}}, "emergency 1"),
    ],
)
def test_whatever_should_not_have_happened_is_a_failure(change, line):
    assert list(failures([GOOD])) == []
    assert list(failures([GOOD | change])) == [f"drive 3, cells, late: {line}"]


def test_the_table_counts_by_class_and_by_situation():
    text = table({"drives": [GOOD, GOOD | {"index": 4, "touched": True}]})
    rows = {line.split("|")[1].strip(): line.split("|") for line in text.splitlines() if line}
    for row in ("answer too late or never", "cells of 0.01–0.5 m"):
        assert [cell.strip() for cell in rows[row][2:5]] == ["2", "0", "1"]
