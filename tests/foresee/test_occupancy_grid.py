"""The laws of the occupancy grid."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foresee.mapping.beams import trace_beams
from foresee.mapping.body import Body
from foresee.mapping.error_bounds import ErrorBounds
from foresee.mapping.family_names import FAMILIES
from foresee.mapping.grid import (
    FREE,
    HIGHEST,
    HIT,
    LOWEST,
    MISS,
    OCCUPIED,
    UNKNOWN,
    Grid,
    GridFrame,
    OccupancyGrid,
)
from foresee.mapping.scan import Scan
from sim.families import generate
from sim.lidar import Lidar, LidarConfig

FRAME = GridFrame(0.1, (-3.0, -3.0), (60, 60))


def scan(ranges, angles=(0.0,), range_max=20.0) -> Scan:
    step = angles[1] - angles[0] if len(angles) > 1 else 0.0
    return Scan(np.asarray(ranges, float), angles[0], step, range_max)


def way_inside(x, y, angle, length, row, col, inset=0.0) -> float:
    """Length of a segment inside a cell, by clipping it against the cell's two slabs."""
    enter, leave = 0.0, length
    for start, direction, low in ((x, math.cos(angle), col), (y, math.sin(angle), row)):
        if abs(direction) < 1e-12:
            if not low + inset < start < low + 1 - inset:
                return 0.0
            continue
        sides = low + inset, low + 1 - inset
        near, far = sorted((side - start) / direction for side in sides)
        enter, leave = max(enter, near), min(leave, far)
    return leave - enter


def assert_matches_slab_oracle(shape, x, y, angle, length, longest):
    marks = np.zeros(shape, np.uint8)
    trace_beams(marks, x, y, angle, 0.0, np.array([length]), longest)
    for row, col in np.ndindex(shape):
        way = x, y, angle, min(length, longest), row, col
        # Between a graze and a crossing lies a band in which either answer is right.
        if way_inside(*way, inset=1e-5) > 1e-5:
            assert marks[row, col]
        if way_inside(*way) < 1e-9:
            assert marks[row, col] != 1
    assert (marks == 2).sum() <= 1
    if (marks == 2).any():
        row, col = np.argwhere(marks == 2)[0]
        end = x + math.cos(angle) * length, y + math.sin(angle) * length
        assert col - 1e-5 <= end[0] <= col + 1 + 1e-5
        assert row - 1e-5 <= end[1] <= row + 1 + 1e-5


@settings(max_examples=300, deadline=None)
@given(
    st.integers(1, 14),
    st.integers(1, 14),
    st.floats(-5, 20),
    st.floats(-5, 20),
    st.floats(-7, 7),
    st.floats(0.01, 40),
)
def test_a_beam_crosses_exactly_the_cells_that_it_passes(rows, cols, x, y, angle, length):
    assert_matches_slab_oracle((rows, cols), x, y, angle, length, 30.0)


@settings(max_examples=200, deadline=None)
@given(
    st.floats(-3, 43),
    st.floats(-3, 43),
    st.floats(-4, 4),
    st.floats(-0.05, 0.05),
    st.lists(st.one_of(st.floats(0.01, 60), st.sampled_from([math.nan, math.inf])), max_size=300),
    st.sampled_from([50.0, math.inf]),
)
def test_a_scan_crosses_what_its_beams_cross_one_by_one(x, y, first, step, ranges, longest):
    together, one_by_one = np.zeros((2, 40, 40), np.uint8)
    trace_beams(together, x, y, first, step, np.array(ranges), longest)
    for beam, length in enumerate(ranges):
        marks = np.zeros((40, 40), np.uint8)
        # A step of -0 leaves even a direction of -0 as it is, which decides between two cells.
        trace_beams(marks, x, y, first + beam * step, -0.0, np.array([length]), longest)
        np.maximum(one_by_one, marks, out=one_by_one)
    assert np.array_equal(together, one_by_one)


@pytest.mark.parametrize("eighth", range(8))
@pytest.mark.parametrize("start", [(5.0, 5.0), (5.5, 5.5), (5.0, 5.5), (5.25, 5.5)])
@pytest.mark.parametrize("length", [1.0, 3.5, 4.0, 50.0])
def test_beams_along_the_axes_and_the_diagonals_are_exact(eighth, start, length):
    assert_matches_slab_oracle((11, 12), *start, eighth * math.pi / 4, length, 30.0)


def test_a_diagonal_beam_through_corners_frees_no_cell_beside_it():
    marks = np.zeros((10, 10), np.uint8)
    trace_beams(marks, 0.0, 0.0, math.pi / 4, 0.0, np.array([100.0]), 100.0)
    assert np.array_equal(marks, np.eye(10, dtype=np.uint8))


def test_a_beam_along_a_line_between_cells_frees_neither_side():
    marks = np.zeros((10, 10), np.uint8)
    trace_beams(marks, 0.0, 5.0, 0.0, 0.0, np.array([8.0]), 100.0)
    assert not (marks == 1).any()


def test_the_cell_that_a_beam_ends_in_is_a_hit_and_the_wall_side_of_an_edge_is_hit():
    marks = np.zeros((3, 10), np.uint8)
    trace_beams(marks, 0.5, 1.5, 0.0, 0.0, np.array([4.5]), 100.0)
    assert marks[1].tolist() == [1, 1, 1, 1, 1, 2, 0, 0, 0, 0]


def test_a_hit_is_not_undone_by_another_beam_of_the_same_scan():
    for ranges in ([3.5, 9.0], [9.0, 3.5]):
        marks = np.zeros((3, 12), np.uint8)
        trace_beams(marks, 0.5, 1.5, 0.0, 0.0, np.array(ranges), 100.0)
        assert marks[1, 4] == 2


def test_each_cell_is_updated_once_a_scan():
    known = OccupancyGrid(FRAME, 4.0)
    angles = np.linspace(-math.pi, math.pi, 1081)
    known.integrate(scan(np.full(1081, 1.0), angles), (0.02, 0.03, 0.0))
    assert set(np.unique(known.log_odds)) == {MISS, 0, HIT}


def test_hits_and_misses_add_up_to_their_bounds():
    known = OccupancyGrid(FRAME, 5.0)
    row, col = FRAME.cell(1.05, 0.05)
    for _ in range(30):
        known.integrate(scan([1.0]), (0.05, 0.05, 0.0))
    assert known.log_odds[row, col] == HIGHEST
    for _ in range(30):
        known.integrate(scan([2.0]), (0.05, 0.05, 0.0))
    assert known.log_odds[row, col] == LOWEST
    assert known.cells[row, col] == FREE


@pytest.mark.parametrize("family", FAMILIES)
def test_without_noise_nothing_that_is_seen_is_wrong(family):
    world = generate(family, 10_000)
    truth, frame, rng = world.grid, world.grid.frame, np.random.default_rng(0)
    for row, col in rng.permutation(np.argwhere(truth.free))[:40]:
        x, y = frame.centre(row + rng.uniform(-0.5, 0.5), col + rng.uniform(-0.5, 0.5))
        pose = x, y, rng.uniform(-math.pi, math.pi)
        known = OccupancyGrid(frame, 10.0)
        known.integrate(Lidar().scan(world, pose), pose)
        seen = known.crop(frame)
        assert not (seen.free & ~truth.free).any()
        assert not (seen.occupied & ~truth.occupied).any()


@pytest.mark.parametrize("family", FAMILIES)
def test_nothing_that_is_seen_from_the_lattice_is_wrong(family):
    """Beams along the lines between cells, and through their corners, end where cells meet."""
    world = generate(family, 10_000)
    truth, frame, rng = world.grid, world.grid.frame, np.random.default_rng(0)
    lidar = Lidar(LidarConfig(mount=(0.0, 0.0, 0.0)))
    for row, col in rng.permutation(np.argwhere(truth.free))[:40]:
        for at in (-0.5, 0.0):
            pose = *frame.centre(row + at, col + at), math.pi / 4 * rng.integers(-3, 5)
            known = OccupancyGrid(frame, 10.0)
            known.integrate(lidar.scan(world, pose), pose)
            seen = known.crop(frame)
            assert not (seen.free & ~truth.free).any()
            assert not (seen.occupied & ~truth.occupied).any()


def test_a_beam_that_ends_in_a_corner_hits_no_cell():
    for angle in np.arange(8) * math.pi / 4:
        marks = np.zeros((9, 9), np.uint8)
        length = 2.0 * (math.sqrt(2.0) if round(4 * angle / math.pi) % 2 else 1.0)
        trace_beams(marks, 4.0, 4.0, angle, 0.0, np.array([length]), 9.0)
        assert not (marks == 2).any()


def test_a_range_of_nan_says_nothing():
    known = OccupancyGrid(FRAME, 5.0)
    known.integrate(scan([math.nan, math.nan], (0.0, 0.1)), (0.0, 0.0, 0.0))
    assert not known.log_odds.any()


@pytest.mark.parametrize("nothing", [math.inf, 1.5, 7.0])
def test_no_return_clears_up_to_the_longest_range(nothing):
    known = OccupancyGrid(FRAME, 5.0)
    known.integrate(scan([nothing], range_max=1.5), (0.05, 0.05, 0.0))
    row, _ = FRAME.cell(0.05, 0.05)
    seen = np.flatnonzero(known.log_odds[row])
    assert seen.tolist() == list(range(FRAME.cell(0.05, 0.05)[1], FRAME.cell(1.55, 0.05)[1] + 1))
    assert not (known.cells == OCCUPIED).any()


def test_the_window_limits_what_is_written_and_what_was_seen_stays():
    known = OccupancyGrid(FRAME, 2.0)
    known.integrate(scan([math.inf]), (0.05, 0.05, 0.0))
    first = known.cells.copy()
    x, _ = known.frame.centres()
    assert x[(first == FREE).any(axis=0)].max() < 1.1
    known.integrate(scan([math.inf]), (-1.5, 0.05, math.pi / 2))
    assert (known.cells[first == FREE] == FREE).all()


def test_growth_keeps_every_cell():
    known = OccupancyGrid(FRAME, 4.0)
    known.integrate(scan([1.0]), (0.05, 0.05, 0.3))
    before = known.crop(FRAME)
    for x, y in ((9.0, 0.0), (-9.0, 3.0), (0.0, -12.0)):
        known.integrate(scan([math.nan]), (x, y, 0.0))
        assert known.log_odds.shape == known.frame.shape
        assert np.array_equal(known.crop(FRAME).cells, before.cells)


def test_a_pose_that_is_not_finite_is_refused():
    with pytest.raises(ValueError, match="finite"):
        OccupancyGrid(FRAME, 4.0).integrate(scan([1.0]), (math.nan, 0.0, 0.0))


def test_beams_that_lie_no_angle_apart_are_refused():
    known, beams = OccupancyGrid(FRAME, 4.0), scan([1.0, 1.0], (0.3, 0.3))
    with pytest.raises(ValueError, match="angle_increment is 0"):
        known.integrate(beams, (0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="angle_increment is 0"):
        known.integrate(scan([1.0]), (0.0, 0.0, 0.0), ErrorBounds(range=0.03))
    assert known.whole().unknown.all()


def test_a_window_must_be_positive():
    with pytest.raises(ValueError, match="positive"):
        OccupancyGrid(FRAME, 0.0)


def test_the_mount_turns_and_moves_the_beams():
    known = OccupancyGrid(FRAME, 6.0)
    mounted = Scan(np.array([1.0]), 0.0, 0.0, 20.0, mount=(0.2, 0.0, math.pi / 2))
    known.integrate(mounted, (0.05, 0.05, math.pi / 2))
    assert [known.cells[known.frame.cell(-0.95 - 0.01, 0.25)]] == [OCCUPIED]


def test_marking_free_erases_no_hit_and_covers_the_body():
    known = OccupancyGrid(FRAME, 5.0)
    known.integrate(scan([0.4]), (0.05, 0.05, 0.0))
    hits = known.cells == OCCUPIED
    known.mark_free((0.05, 0.05, 0.7), Body(0.5, 0.3), 0.5)
    assert (known.cells[hits] == OCCUPIED).all()
    assert known.cells[FRAME.cell(0.05, -0.5)] == FREE
    assert known.cells[FRAME.cell(0.05, -2.0)] == UNKNOWN


def test_cropping_and_growing_back_gives_the_same_cells():
    rng = np.random.default_rng(0)
    grid = Grid(FRAME, rng.choice(np.array([FREE, OCCUPIED, UNKNOWN], np.int8), FRAME.shape))
    wide = grid.crop(GridFrame(0.1, (-4.0, -5.0), (90, 80)))
    assert np.array_equal(wide.crop(FRAME).cells, grid.cells)
    assert wide.unknown.sum() == grid.unknown.sum() + 90 * 80 - 60 * 60
    away = grid.crop(GridFrame(0.1, (50.0, 50.0), (7, 5)))
    assert away.unknown.all()
    assert np.array_equal(OccupancyGrid.from_grid(grid, 5.0).cells, grid.cells)


@pytest.mark.parametrize(
    "other", [GridFrame(0.1, (0.05, 0.0), (5, 5)), GridFrame(0.2, (0.0, 0.0), (5, 5))]
)
def test_frames_that_share_no_lattice_are_refused(other):
    with pytest.raises(ValueError, match="lattice"):
        FRAME.offset(other)


def test_cells_must_have_the_shape_of_their_frame():
    with pytest.raises(ValueError, match="frame says"):
        Grid(FRAME, np.zeros((3, 3), np.int8))


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(0.2, 30))
def test_a_square_lies_on_the_lattice_around_its_point(x, y, side):
    square = FRAME.square(x, y, side)
    FRAME.offset(square)
    assert square.shape == (max(1, round(side / 0.1)),) * 2
    centre = square.centre((square.shape[0] - 1) / 2, (square.shape[1] - 1) / 2)
    assert max(abs(centre[0] - x), abs(centre[1] - y)) <= 0.05 + 1e-6


def test_a_cell_holds_its_own_centre():
    x, y = FRAME.centres()
    assert FRAME.cell(x[7], y[11]) == (11, 7)
    assert FRAME.centre(11, 7) == pytest.approx((x[7], y[11]))
    assert FRAME.contains(0.0, 0.0)
    assert not FRAME.contains(3.05, 0.0)
    assert FRAME.size == pytest.approx((6.0, 6.0))


@pytest.mark.parametrize("beams", [181, 541, 1081])
@pytest.mark.parametrize("start", [(100.3, 99.6), (12.5, 150.2)])
def test_a_scan_of_a_wide_room_leaves_out_no_cell_between_its_beams(beams, start):
    first, step = math.radians(-135.0), math.radians(270.0) / (beams - 1)
    together, one_by_one = np.zeros((2, 200, 200), np.uint8)
    trace_beams(together, *start, first, step, np.full(beams, math.inf), 150.0)
    for beam in range(beams):
        trace_beams(one_by_one, *start, first + beam * step, 0.0, np.array([math.inf]), 150.0)
    assert np.array_equal(together, one_by_one)


def test_the_log_odds_are_those_of_octomap():
    def log_odds(p):
        return math.log(p / (1.0 - p))

    # Hornung et al. 2013: probabilities of a hit and a miss, and the bounds of clamping.
    steps = [HIT, MISS, LOWEST, HIGHEST]
    wanted = [log_odds(p) for p in (0.7, 0.4, 0.12, 0.97)]
    assert [0.05 * step for step in steps] == pytest.approx(wanted, abs=0.03)


@pytest.mark.parametrize(("log_odds", "cell"), [(-1, FREE), (0, UNKNOWN), (1, OCCUPIED)])
def test_a_single_step_of_log_odds_decides_what_a_cell_is(log_odds, cell):
    known = OccupancyGrid(FRAME, 5.0)
    known.log_odds[:] = log_odds
    assert (known.cells == cell).all()


def test_beyond_the_observed_map_nothing_is_known():
    known = OccupancyGrid.from_grid(Grid(FRAME, np.full(FRAME.shape, FREE, np.int8)), 5.0)
    wider = known.crop(GridFrame(0.1, (-4.0, -4.0), (80, 80)))
    assert wider.free[10:70, 10:70].all()
    assert wider.unknown.sum() == 80 * 80 - 60 * 60


def test_a_frame_a_fifth_of_a_cell_off_is_on_another_lattice():
    with pytest.raises(ValueError, match="lattice"):
        FRAME.offset(GridFrame(0.1, (0.02, 0.0), (5, 5)))


def test_marking_free_grows_the_map_under_the_whole_body():
    known = OccupancyGrid(FRAME, 5.0)
    # The map ends at x = 3 m, the marked cells at 3.15 m.
    known.mark_free((2.4, 0.0, 0.0), Body(0.5, 0.3), 0.5)
    assert known.cells[known.frame.cell(3.12, 0.0)] == FREE


def test_the_edge_of_a_body_marks_the_same_cells_wherever_the_frame_begins():
    # 10.6 + 20.35 = 30.95, to which the body reaches, but for the last digit.
    for first in (0, 212):
        frame = GridFrame(0.05, (first * 0.05, 0.0), (600, 900))
        known = OccupancyGrid(frame, 5.0)
        known.mark_free((31.5, 11.9, 3.141592653589793), Body(0.5, 0.3), 0.3)
        cols = np.nonzero((known.log_odds < 0).any(axis=0))[0] + first
        assert (cols[0], cols[-1]) == (619, 640)
