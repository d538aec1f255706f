"""The laws of the classical predictor."""

import math

import numpy as np
import pytest

from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from foresee.mapping.straight_lines import NONE, OPEN, WALL, look_back, main_direction, nearness
from foresee.prediction import View
from predictor.extend import Extend

N = 200
FRAME = GridFrame(0.05, (0.0, 0.0), (N, N))
POSE = np.array([5.0, 5.0, 0.0])


def corridor(angle: float, width: float = 2.0, end: float | None = None) -> Grid:
    """A straight corridor through the middle, seen in a square of 5 m; `end` bars it [m ahead]."""
    x, y = (values - 5.0 for values in FRAME.centres())
    along = x[None, :] * math.cos(angle) + y[:, None] * math.sin(angle)
    across = y[:, None] * math.cos(angle) - x[None, :] * math.sin(angle)
    half = width / 2
    free = abs(across) < half
    wall = (abs(across) >= half) & (abs(across) < half + 0.075)
    cells = np.full((N, N), UNKNOWN, np.int8)
    cells[free] = FREE
    cells[wall] = OCCUPIED
    if end is not None:
        cells[along > end + 0.075] = UNKNOWN
        cells[free & (along > end) & (along <= end + 0.075)] = OCCUPIED
    cells[(abs(x)[None, :] > 2.5) | (abs(y)[:, None] > 2.5)] = UNKNOWN
    return Grid(FRAME, cells)


def trusted(known: Grid, yaw: float = 0.0):
    prediction = Extend().predict(View(known, np.array([5.0, 5.0, yaw])))
    return prediction.confidence * prediction.p_free, prediction.confidence * prediction.p_occupied


def test_a_straight_corridor_goes_on_as_free_with_walls():
    free, occupied = trusted(corridor(0.0))
    assert free[90:110, 152].min() > 0.9
    assert free[90:110, 165].min() > 0.6
    wall = corridor(0.0).cells[:, 100] == OCCUPIED
    assert occupied[wall, 155].min() > 3 * np.delete(occupied[:, 155], np.flatnonzero(wall)).max()
    assert free[:60, 155].max() < 0.3


@pytest.mark.parametrize("angle", [0.0, 0.2, math.pi / 4, 1.1])
def test_what_is_relied_on_falls_with_the_distance_from_the_frontier(angle):
    prediction = Extend().predict(View(corridor(angle), POSE))
    steps = np.arange(3.7, 4.9, 0.15)
    rows, cols = ((5 + steps * f(angle)) / 0.05 for f in (math.sin, math.cos))
    at = rows.astype(int), cols.astype(int)
    assert (np.diff(prediction.confidence[at]) < 0).all()
    assert (np.diff((prediction.confidence * prediction.p_free)[at]) < 0).all()


@pytest.mark.parametrize("degrees", [10, 30, 45, 60, 77])
def test_a_slanting_corridor_goes_on_as_well_as_a_straight_one(degrees):
    angle = math.radians(degrees)
    free, _ = trusted(corridor(angle))
    edge = 2.5 / max(math.cos(angle), math.sin(angle))
    for beyond, least in ((0.1, 0.9), (0.8, 0.6)):
        x, y = ((edge + beyond) * f(angle) + 5.0 for f in (math.cos, math.sin))
        assert free[FRAME.cell(x, y)] > least


@pytest.mark.parametrize("angle", [0.0, 0.3, math.pi / 4])
def test_turning_the_map_by_a_right_angle_turns_the_prediction(angle):
    known = corridor(angle, end=1.5)
    turned = Grid(FRAME, np.rot90(known.cells).copy())
    for straight, other in zip(trusted(known), trusted(turned), strict=True):
        # Lines of cells round differently upwards and downwards: equal but for a cell's shift.
        difference = abs(np.rot90(straight) - other)
        assert difference.mean() < 0.01


def test_mirroring_the_map_mirrors_the_prediction():
    known = corridor(0.3, end=1.5)
    mirrored = Grid(FRAME, known.cells[::-1].copy())
    assert abs(trusted(known)[0][::-1] - trusted(mirrored)[0]).mean() < 0.01


@pytest.mark.parametrize("angle", [0.0, 0.4, math.pi / 4])
def test_nothing_behind_a_dead_end_is_relied_on(angle):
    free, _ = trusted(corridor(angle, end=1.5))
    steps = np.arange(1.65, 4.9, 0.05)
    for side in (-0.5, 0.0, 0.5):
        x = 5 + steps * math.cos(angle) - side * math.sin(angle)
        y = 5 + steps * math.sin(angle) + side * math.cos(angle)
        assert free[(y / 0.05).astype(int), (x / 0.05).astype(int)].max() < 0.3


def test_an_unknown_map_has_no_confidence():
    known = Grid(FRAME, np.full((N, N), UNKNOWN, np.int8))
    assert not Extend().predict(View(known, POSE)).confidence.any()


def test_probabilities_add_up_to_one_at_most():
    rng = np.random.default_rng(0)
    known = Grid(FRAME, rng.choice(np.array([FREE, OCCUPIED, UNKNOWN], np.int8), (N, N)))
    for grid in (known, corridor(0.3)):
        prediction = Extend().predict(View(grid, POSE))
        assert (prediction.p_free + prediction.p_occupied <= 1 + 1e-6).all()
        assert prediction.p_free.min() >= 0
        assert prediction.confidence.max() <= 1


@pytest.mark.parametrize("degrees", range(0, 90, 7))
def test_the_main_direction_is_that_of_the_walls(degrees):
    found = math.degrees(main_direction(corridor(math.radians(degrees)).cells, default=1.0))
    assert abs((found - degrees + 45) % 90 - 45) < 1.0


def test_without_walls_the_main_direction_is_the_default():
    cells = np.full((N, N), FREE, np.int8)
    assert main_direction(cells, default=math.pi / 2 + 0.3) == pytest.approx(0.3)


def test_no_line_slips_through_a_diagonal_wall_that_is_joined_by_corners():
    cells = np.full((40, 40), UNKNOWN, np.int8)
    row, col = np.indices(cells.shape)
    cells[row + col < 40] = FREE
    cells[row + col == 40] = OCCUPIED
    kind, _, _ = look_back(cells, math.pi / 4, 10.0)
    assert not (kind[0] == OPEN)[row + col > 40].any()


def test_a_line_remembers_how_long_it_was_open():
    cells = np.full((1, 50), UNKNOWN, np.int8)
    cells[0, 10:30] = FREE
    kind, distance, support = look_back(cells, 0.0, 10.0)
    assert kind[0, 0, 35] == OPEN
    assert distance[0, 0, 35] == 6.0
    assert support[0, 0, 35] == pytest.approx(1 - math.exp(-2.0))
    assert kind[0, 0, 5] == NONE
    assert kind[1, 0, 5] == OPEN


def test_a_wall_along_a_line_has_more_support_than_one_across():
    cells = np.full((50, 50), UNKNOWN, np.int8)
    cells[20, :30] = OCCUPIED
    kind, _, support = look_back(cells, 0.0, 10.0)
    assert kind[0, 20, 40] == WALL
    assert support[0, 20, 40] > 0.9
    assert kind[2, 30, 10] == WALL
    assert support[2, 30, 10] < 0.3


def test_nearness_falls_with_the_distance():
    cells = np.full((31, 31), UNKNOWN, np.int8)
    cells[15, 15] = OCCUPIED
    near = nearness(cells, OCCUPIED, 5.0)
    row, col = np.indices(cells.shape) - 15
    distance = np.hypot(row, col)
    assert near == pytest.approx(np.exp(-distance / 5.0), rel=0.5)
    assert -5.0 * np.log(near) == pytest.approx(distance, rel=0.1, abs=0.1)
    assert not nearness(cells, FREE, 5.0).any()
