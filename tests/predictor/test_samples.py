"""What drives leave behind to learn from: written whole, read safely, kept apart."""

import itertools
import zlib

import numpy as np
import pytest

from foresee.mapping.body import Body
from foresee.mapping.context import CELLS, coarse_context
from foresee.mapping.context import SIDE as CONTEXT
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame, world_hash
from predictor.data.packed_samples import SamplesError
from predictor.data.samples import SIDE, Samples, encoded, quarters, write_samples
from predictor.data.splits import SplitError, check_apart
from predictor.recording.rescan import rescanned
from sim.buildings import task_in
from sim.lidar import LidarConfig

FRAME = GridFrame(0.05, (0.0, 0.0), (SIDE, SIDE))


def around_of(known):
    """The observed map of the square of the context."""
    return known.crop(FRAME.square(*FRAME.centre(SIDE / 2, SIDE / 2), CONTEXT))


def some_sample(seed=0, yaw=0.0):
    rng = np.random.default_rng(seed)
    known = Grid(FRAME, rng.choice(np.array([FREE, OCCUPIED, UNKNOWN], np.int8), FRAME.shape))
    truth = rng.integers(0, 3, FRAME.shape, dtype=np.uint8)
    return known, truth, encoded(known, truth, around_of(known), yaw)


def write(folder, name="000000", world="a", samples=None):
    folder.mkdir(parents=True, exist_ok=True)
    blobs = samples if samples is not None else [some_sample(seed)[2] for seed in range(3)]
    path = folder / f"{name}.npz"
    write_samples(
        path,
        [(blob, np.zeros(3)) for blob in blobs],
        {"seed": 1, "world": world, "original": f"{world} as drawn"},
    )
    return path


def test_a_sample_comes_back_as_it_was(tmp_path):
    known, truth, blob = some_sample()
    write(tmp_path, samples=[blob])
    codes = Samples.load(tmp_path)[0]
    seen = np.select([known.cells == FREE, known.cells == OCCUPIED], [0, 1], 2)
    assert np.array_equal(codes % 3, seen)
    assert np.array_equal(codes // 3, truth)


@pytest.mark.parametrize("yaw", np.linspace(-3.1, 3.1, 9))
def test_what_lies_ahead_of_the_robot_lies_along_x(tmp_path, yaw):
    truth = np.full(FRAME.shape, 2, np.uint8)
    middle = SIDE // 2
    ahead = round(100 * np.cos(yaw)), round(100 * np.sin(yaw))
    truth[middle + ahead[1] - 3 : middle + ahead[1] + 3, middle + ahead[0] - 3 :][:, :6] = 0
    known = Grid(FRAME, np.full(FRAME.shape, UNKNOWN, np.int8))
    write(tmp_path, samples=[encoded(known, truth, around_of(known), yaw)])
    rows, cols = np.nonzero(Samples.load(tmp_path)[0] // 3 == 0)
    x, y = cols.mean() - middle, rows.mean() - middle
    assert x > abs(y) - 2


def test_the_context_is_turned_as_the_sample_is(tmp_path):
    cells = np.full(FRAME.shape, UNKNOWN, np.int8)
    cells[: SIDE // 4, : SIDE // 2] = FREE
    cells[SIDE // 4 : SIDE // 2, : SIDE // 2] = OCCUPIED
    known, truth = Grid(FRAME, cells), np.full(FRAME.shape, 2, np.uint8)
    truth[: SIDE // 2, : SIDE // 4] = 0
    for yaw in (0.0, 1.5, 3.0, -1.5):
        write(tmp_path, samples=[encoded(known, truth, around_of(known), yaw)])
        samples = Samples.load(tmp_path)
        codes, coarse = (part[0] for part in samples.parts(samples.stacked(np.array([0]), 100)))
        assert np.array_equal(codes, samples[0])
        edge = (CELLS - SIDE // 10) // 2
        inside = coarse[:, edge : CELLS - edge, edge : CELLS - edge]
        for kind in range(2):
            blocks = (codes % 3 == kind).reshape(SIDE // 10, 10, SIDE // 10, 10)
            assert np.array_equal(inside[kind], blocks.sum(axis=(1, 3)))
        assert coarse.sum() == inside.sum()


@pytest.mark.parametrize("resolution", [0.03, 0.05, 0.1, 0.17])
def test_a_context_is_in_percent_at_any_resolution(resolution):
    n = round(CONTEXT / resolution)
    cells = np.full((n, n), UNKNOWN, np.int8)
    cells[: n // 2] = FREE
    context = coarse_context(Grid(GridFrame(resolution, (0.0, 0.0), (n, n)), cells))
    assert context.shape == (2, CELLS, CELLS)
    assert (context[0, : CELLS // 2 - 1] == 100).all()
    assert not context[0, CELLS // 2 + 1 :].any()
    assert not context[1].any()


def test_a_context_of_another_size_is_refused():
    with pytest.raises(ValueError, match="it must be of 40"):
        coarse_context(Grid(FRAME, np.full(FRAME.shape, UNKNOWN, np.int8)))


def test_quarter_turns_cover_every_heading():
    assert [quarters(q * np.pi / 2) for q in range(-2, 3)] == [2, 3, 0, 1, 2]


def test_the_first_drives_are_read_when_not_all_are_wanted(tmp_path):
    for number in range(4):
        write(tmp_path, f"{number:06d}", world=str(number))
    assert len(Samples.load(tmp_path)) == 12
    assert Samples.load(tmp_path, 2).worlds == {"0", "0 as drawn", "1", "1 as drawn"}


def test_a_drive_that_is_missing_between_others_is_an_error(tmp_path):
    for number in range(4):
        write(tmp_path, f"{number:06d}", world=str(number))
    (tmp_path / "000002.npz").unlink()
    with pytest.raises(SamplesError, match="misses 1 of its drives"):
        Samples.load(tmp_path)
    assert len(Samples.load(tmp_path, 2)) == 6


def test_a_drive_without_samples_is_no_harm(tmp_path):
    write(tmp_path, "000000", samples=[])
    write(tmp_path, "000001")
    assert len(Samples.load(tmp_path)) == 3


def test_drives_without_a_single_sample_are_an_error(tmp_path):
    write(tmp_path, samples=[])
    with pytest.raises(SamplesError, match="without a single sample"):
        Samples.load(tmp_path)


def test_a_varied_building_is_in_the_same_split_as_the_one_it_was_made_of(tmp_path):
    write(tmp_path / "a", world="turned")
    write(tmp_path / "b", world="turned as drawn")
    one, other = (Samples.load(tmp_path / name) for name in "ab")
    with pytest.raises(SplitError, match="1 buildings"):
        check_apart({"one": one.worlds, "other": other.worlds})


def test_an_empty_folder_says_how_to_fill_it(tmp_path):
    with pytest.raises(SamplesError, match=r"predictor\.drives"):
        Samples.load(tmp_path)


def test_a_damaged_file_is_named(tmp_path):
    path = write(tmp_path)
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(SamplesError, match=r"000000\.npz is damaged"):
        Samples.load(tmp_path)


def test_a_foreign_file_is_named(tmp_path):
    np.savez(tmp_path / "000000.npz", something=np.zeros(3))
    with pytest.raises(SamplesError, match="damaged"):
        Samples.load(tmp_path)


def test_a_damaged_sample_is_an_error(tmp_path):
    write(tmp_path, samples=[b"not compressed at all"])
    with pytest.raises(SamplesError, match="sample 0, of the drive of seed 1, is damaged"):
        Samples.load(tmp_path)[0]


def test_codes_that_do_not_exist_are_an_error_of_a_training_too(tmp_path):
    data = np.zeros(Samples.SIZE, np.uint8)
    data[-1] = 100
    for code in (8, 9):
        data[5] = code
        write(tmp_path / str(code), samples=[zlib.compress(data.tobytes())])
    assert Samples.load(tmp_path / "8").stacked(np.array([0]), 100)[0, 5] == 8
    with pytest.raises(SamplesError, match="codes above 8"):
        Samples.load(tmp_path / "9").stacked(np.array([0]), 100)


def test_a_building_in_two_splits_is_refused(tmp_path):
    write(tmp_path / "train", world="a")
    write(tmp_path / "validation", world="b")
    train, validation = (Samples.load(tmp_path / name) for name in ("train", "validation"))
    check_apart({"train": train.worlds, "validation": validation.worlds})
    with pytest.raises(SplitError, match="2 buildings are both in train and in again"):
        check_apart({"train": train.worlds, "again": train.worlds})


def test_the_hash_tells_buildings_apart():
    cells = np.zeros((20, 30), np.int8)
    other = cells.copy()
    other[3, 4] = OCCUPIED
    assert world_hash(cells) == world_hash(cells.copy())
    assert len({world_hash(cells), world_hash(other), world_hash(cells.T.copy())}) == 3


def test_no_wall_beside_a_start_is_recorded_as_free():
    starts = (task_in("narrow", seed) for seed in itertools.count(1_600_000))
    task = next(task for task in starts if task.start_margin(Body()) < 0.3)
    (known, _), *_ = rescanned(
        task, np.array([task.start]), 5.0, LidarConfig(), np.random.default_rng(0), 1
    )
    seen = known.whole()
    assert not (seen.free & task.world.grid.crop(seen.frame).occupied).any()
