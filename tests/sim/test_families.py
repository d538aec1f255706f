import numpy as np
import pytest
from scipy.ndimage import binary_dilation, label

from foresee.mapping.family_names import FAMILIES
from foresee.mapping.grid import OCCUPIED, UNKNOWN
from sim.as_built import LARGEST, Style
from sim.building_statistics import building_statistics
from sim.families import empty_straight, generate

SEEDS = range(6)
CASES = [(family, seed) for family in FAMILIES for seed in SEEDS]
# A building of which no room was left.
CASES.append(("floor_plan", 1_200_982))
# A hall alone, of which a robot would enter no room.
CASES.append(("as_built", 439))
# A room behind closed doors that is larger than the corridors along which the robot would drive.
CASES.append(("as_built", 10_368))


@pytest.mark.parametrize("family", FAMILIES)
def test_the_same_seed_gives_the_same_world_and_another_another(family):
    first, again, other = generate(family, 7), generate(family, 7), generate(family, 8)
    assert np.array_equal(first.grid.cells, again.grid.cells)
    assert first.name == again.name != other.name
    assert not np.array_equal(first.grid.cells, other.grid.cells)


@pytest.mark.parametrize(("family", "seed"), CASES)
def test_free_space_is_walled_in_and_unknown_lies_behind_the_walls(family, seed):
    grid = generate(family, seed).grid
    assert grid.frame.resolution == 0.05
    assert not (binary_dilation(grid.free, np.ones((3, 3))) & grid.unknown).any()
    for edge in (grid.cells[0], grid.cells[-1], grid.cells[:, 0], grid.cells[:, -1]):
        assert np.isin(edge, (OCCUPIED, UNKNOWN)).all()


@pytest.mark.parametrize(("family", "seed"), CASES)
def test_walls_are_two_cells_thick(family, seed):
    free = generate(family, seed).grid.free
    # A wall one cell thick shows as a solid cell between two free ones, in a row or a column.
    for plane in (free, free.T):
        thin = plane[:, :-2] & ~plane[:, 1:-1] & plane[:, 2:]
        # Corners of slanted walls may come to a point; a line would be a wall.
        runs, _ = label(thin, np.ones((3, 3)))
        assert np.bincount(runs[thin], minlength=1).max() <= 5


@pytest.mark.parametrize(("family", "seed"), CASES)
def test_a_building_is_one_piece_of_the_right_size(family, seed):
    grid = generate(family, seed).grid
    pieces, _ = label(grid.free)
    assert np.bincount(pieces[grid.free]).max() > 0.97 * grid.free.sum()
    # A turned corner, the ground around and walls add to the largest extent of `as_built`.
    assert 20 < max(grid.frame.size) < LARGEST + 2


def test_widths_of_corridors_are_those_of_the_paper():
    for seed in SEEDS:
        clearance = generate("corridor", seed).clearance
        # The widest circle that fits: half of the widest corridor at least, of a crossing at most.
        assert 3.5 / 2 - 0.1 < clearance.max() < 10 / 2 * np.sqrt(2) + 0.1


def test_an_empty_straight_is_empty_and_straight():
    world = empty_straight(60.0, 4.0)
    assert world.grid.free.sum() == (60 / 0.05) * (4 / 0.05)
    assert world.grid.frame.size == pytest.approx((60.3, 4.3))


def test_an_unknown_family_is_told_which_there_are():
    with pytest.raises(ValueError, match="corridor, narrow, office, trap"):
        generate("palace", 0)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_papers_buildings_have_ways_round_and_the_papers_widths(seed):
    world = generate("paper", seed)
    # Solid ground that touches no edge of the map lies inside a loop.
    solid, count = label(world.solid, np.ones((3, 3)))
    edges = np.concatenate([solid[0], solid[-1], solid[:, 0], solid[:, -1]])
    assert count - len(set(edges[edges > 0])) >= 1
    # The widest circle that fits is no wider than a crossing of the widest paths, and a path of
    # the narrowest width lets a circle of that width through everywhere.
    assert world.clearance.max() < 10 / 2 * np.sqrt(2) + 0.1
    middle, _ = label(world.clearance > 3.5 / 2 - 0.1)
    assert np.bincount(middle[middle > 0]).max() > 0.95 * (middle > 0).sum()


def test_robots_maps_are_rougher_and_more_cluttered_than_architects_plans():
    numbers = {True: [], False: []}
    for seed in range(30):
        style = Style.drawn(np.random.default_rng([FAMILIES.index("as_built"), seed]))
        of = building_statistics(generate("as_built", seed), np.random.default_rng(0))
        numbers[style.mapping is not None].append((of["walls"], of["small"], -of["clearance"]))
    robots, plans = (np.median(numbers[by_robot], axis=0) for by_robot in (True, False))
    assert (robots > plans).all()
    # Quartiles of the validation maps: walls 0.36–0.81 m/m² in plans; 46–101 small obstacles per
    # 100 m² in robots' maps, none in most plans.
    assert 0.25 < plans[0] < 1.2
    assert plans[1] < 5.0
    assert 5.0 < robots[1] < 150.0
