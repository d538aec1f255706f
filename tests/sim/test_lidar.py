import math

import numpy as np
import pytest

from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from sim.lidar import Lidar, LidarConfig, cast_rays
from sim.world import World, empty_squares

AROUND = LidarConfig(fov=2 * math.pi, beams=360, range_max=200.0, mount=(0, 0, 0))


def world_of(cells: np.ndarray, resolution: float = 1.0) -> World:
    return World("test", Grid(GridFrame(resolution, (0.0, 0.0), cells.shape), cells))


def cast(cells: np.ndarray, x: float, y: float, angles: np.ndarray, longest: float) -> np.ndarray:
    beams = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return cast_rays(empty_squares(cells != FREE), cells, x, y, 0.0, beams, longest)


def slab(cells: np.ndarray, x: float, y: float, angle: float, longest: float) -> float | None:
    """The exact answer, from every cell's own slabs; None if a corner decides it."""
    dx, dy = math.cos(angle), math.sin(angle)
    solid = np.pad(cells, 1, constant_values=UNKNOWN)
    r, c = np.nonzero(solid != FREE)
    with np.errstate(divide="ignore"):
        tx = np.sort(np.stack([c - 1 - x, c - x]) / dx, axis=0)
        ty = np.sort(np.stack([r - 1 - y, r - y]) / dy, axis=0)
    enter, leave = np.maximum(tx[0], ty[0]), np.minimum(tx[1], ty[1])
    if np.any((np.abs(leave - enter) < 1e-9) & (leave > 0)):
        return None
    met = (enter < leave) & (leave > 0)
    first = np.flatnonzero(met)[np.argmin(enter[met])]
    if enter[first] >= longest:
        return math.inf
    return enter[first] if solid[r[first], c[first]] == OCCUPIED else math.nan


@pytest.mark.parametrize("share", [0.005, 0.05, 0.3])
def test_ranges_are_those_of_exact_slabs_on_random_grids(share):
    rng = np.random.default_rng(int(share * 1000))
    compared = 0
    for _ in range(60):
        shape = tuple(rng.integers(3, 60, 2))
        cells = rng.choice(
            np.array([FREE, OCCUPIED, UNKNOWN], np.int8),
            shape,
            p=[1 - share, 0.7 * share, 0.3 * share],
        )
        row, col = rng.integers(0, shape)
        cells[row, col] = FREE
        x, y = col + rng.random(), row + rng.random()
        angles = rng.uniform(-math.pi, math.pi, 40)
        for angle, got in zip(angles, cast(cells, x, y, angles, 35.0), strict=True):
            want = slab(cells, x, y, angle, 35.0)
            if want is None:
                continue
            compared += 1
            assert got == pytest.approx(want, abs=1e-9, nan_ok=True)
    assert compared > 2000


def test_axis_aligned_rays_are_exact():
    cells = np.full((40, 50), FREE, np.int8)
    cells[:, [0, -1]] = cells[[0, -1], :] = OCCUPIED
    angles = np.array([0, math.pi / 2, math.pi, -math.pi / 2])
    for x, y in ((10.0, 12.0), (10.5, 12.5), (1.0, 1.0)):
        got = cast(cells, x, y, angles, 500.0)
        assert np.allclose(got, [49 - x, 39 - y, x - 1, y - 1], atol=1e-9)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("kind", [OCCUPIED, UNKNOWN])
def test_no_ray_passes_a_diagonal_wall_one_cell_thick(mirrored, kind):
    n = 41
    cells = np.full((n, n), FREE, np.int8)
    cells[np.arange(n), np.arange(n)] = kind
    cells[0, 1] = FREE
    # Beyond the wall everything returns, so a ray that leaked would return from there.
    cells[-1, :-1] = cells[:-1, 0] = OCCUPIED
    if mirrored:
        cells = cells[:, ::-1].copy()
    rng = np.random.default_rng(1)
    angles = np.concatenate(
        [np.arange(-16, 17) * math.pi / 16, rng.uniform(-math.pi, math.pi, 200)]
    )
    for _ in range(100):
        row = int(rng.integers(1, n - 1))
        col = int(rng.integers(row + 1, n))
        for fx, fy in ((0.5, 0.5), (0.0, 0.0), (0.0, 0.5), tuple(rng.random(2))):
            x, y = col + fx, row + fy
            got = cast(cells, n - x if mirrored else x, y, angles, 1e3)
            for angle, r in zip(angles, got, strict=True):
                if math.isfinite(r):
                    end = x + (-1 if mirrored else 1) * r * math.cos(angle)
                    assert y + r * math.sin(angle) - end < 1.0 + 1e-9
                assert r != math.inf


def test_exact_diagonal_rays_stop_between_two_cells_that_touch_at_a_corner():
    cells = np.full((9, 9), FREE, np.int8)
    cells[4, 5] = cells[5, 4] = OCCUPIED
    diagonals = np.array([1, 3, -1, -3]) * math.pi / 4
    for start in (0.5, 1.0, 2.0, 3.5):
        got = cast(cells, start, start, diagonals[:1], 100.0)
        assert got[0] == pytest.approx((5 - start) * math.sqrt(2), abs=1e-9)
    got = cast(cells, 8.5, 8.5, diagonals[3:], 100.0)
    assert got[0] == pytest.approx(3.5 * math.sqrt(2), abs=1e-9)
    # The same pair, mirrored, for the other two directions.
    flipped = cells[:, ::-1].copy()
    got = cast(flipped, 0.5, 8.5, diagonals[2:3], 100.0)
    assert got[0] == pytest.approx(3.5 * math.sqrt(2), abs=1e-9)
    got = cast(flipped, 8.5, 0.5, diagonals[1:2], 100.0)
    assert got[0] == pytest.approx(4.5 * math.sqrt(2), abs=1e-9)


def test_unknown_and_the_end_of_the_map_say_nothing_and_range_says_infinity():
    cells = np.full((10, 100), FREE, np.int8)
    cells[:, 60] = UNKNOWN
    right = np.array([0.0])
    assert math.isnan(cast(cells, 50.5, 5.5, right, 50.0)[0])
    assert math.isnan(cast(cells, 80.5, 5.5, right, 50.0)[0])
    assert cast(cells, 30.5, 5.5, right, 20.0)[0] == math.inf
    assert np.isnan(cast(cells, 60.5, 5.5, right, 20.0)).all()
    assert np.isnan(cast(cells, -3.0, 5.5, right, 20.0)).all()


def test_squares_longer_than_a_byte_can_say_change_nothing():
    cells = np.full((700, 700), FREE, np.int8)
    cells[:, [0, -1]] = cells[[0, -1], :] = OCCUPIED
    angles = np.linspace(-3, 3, 50)
    got = cast(cells, 350.2, 349.7, angles, 5000.0)
    for angle, r in zip(angles, got, strict=True):
        assert r == pytest.approx(slab(cells, 350.2, 349.7, angle, 5000.0), abs=1e-9)


def test_a_scan_turns_with_the_robot_and_its_mount():
    cells = np.full((60, 60), FREE, np.int8)
    cells[:, [0, -1]] = cells[[0, -1], :] = OCCUPIED
    world = world_of(cells, 0.1)
    mounted = Lidar(LidarConfig(beams=31, mount=(0.3, -0.2, 0.4)))
    bare = Lidar(LidarConfig(beams=31, mount=(0, 0, 0)))
    pose = (2.0, 3.0, 0.7)
    scan = mounted.scan(world, pose)
    assert np.allclose(scan.ranges, bare.scan(world, scan.sensor_pose(*pose)).ranges, atol=1e-9)
    assert scan.ranges.shape == (31,)
    assert scan.angle_min + 30 * scan.angle_increment == pytest.approx(math.radians(135))


def test_the_ranges_of_a_scan_are_exact_anywhere_on_a_map():
    rng = np.random.default_rng(1)
    cells = np.where(rng.random((300, 400)) < 0.01, OCCUPIED, FREE).astype(np.int8)
    frame = GridFrame(0.05, (-3.0, 7.0), cells.shape)
    world, lidar, compared = World("test", Grid(frame, cells)), Lidar(), 0
    for row, col in rng.permutation(np.argwhere(cells == FREE))[:5]:
        pose = (frame.origin[0] + 0.05 * (col + rng.random()), 7.0 + 0.05 * (row + rng.random()))
        scan = lidar.scan(world, (*pose, 0.7))
        x, y, bearing = scan.sensor_pose(*pose, 0.7)
        u, v = (x - frame.origin[0]) / 0.05, (y - frame.origin[1]) / 0.05
        if cells[frame.cell(x, y)] != FREE:
            continue
        for beam in range(0, len(scan.ranges), 20):
            angle = bearing + scan.angle_min + beam * scan.angle_increment
            want = slab(cells, u, v, angle, scan.range_max / 0.05)
            if want is not None:
                compared += 1
                assert scan.ranges[beam] == pytest.approx(0.05 * want, abs=1e-9, nan_ok=True)
    assert compared > 100


def test_a_full_circle_has_no_beam_twice():
    assert AROUND.angle_increment * AROUND.beams == pytest.approx(2 * math.pi)


def test_noise_touches_returns_only_and_the_seed_decides():
    cells = np.full((60, 60), FREE, np.int8)
    cells[:, -1] = OCCUPIED
    cells[0] = UNKNOWN
    world = world_of(cells)
    quiet = LidarConfig(fov=2 * math.pi, beams=720, range_max=25.0, mount=(0, 0, 0))
    noisy = LidarConfig(**{**vars(quiet), "range_noise": 0.05, "dropout": 0.2})
    pose = (45.0, 30.0, 0.3)
    exact = Lidar(quiet).scan(world, pose).ranges
    first = Lidar(noisy).scan(world, pose, np.random.default_rng(3)).ranges
    again = Lidar(noisy).scan(world, pose, np.random.default_rng(3)).ranges
    assert np.array_equal(first, again, equal_nan=True)
    kept = ~np.isnan(first)
    assert 0.1 < 1 - kept[~np.isnan(exact)].mean() < 0.3
    assert np.array_equal(np.isinf(first[kept]), np.isinf(exact[kept]))
    returned = kept & np.isfinite(exact)
    assert 0.03 < np.std(first[returned] - exact[returned]) < 0.07
    with pytest.raises(ValueError, match="rng"):
        Lidar(noisy).scan(world, pose)


def test_misuse_says_what_is_wrong():
    with pytest.raises(ValueError, match="fov"):
        LidarConfig(fov=7.0)
    with pytest.raises(ValueError, match="dropout"):
        LidarConfig(dropout=1.5)
    with pytest.raises(ValueError, match="finite"):
        Lidar().scan(world_of(np.zeros((5, 5), np.int8)), (math.nan, 0, 0))


def test_a_disc_is_met_where_a_beam_enters_its_circle_and_not_through_a_wall():
    cells = np.full((40, 40), FREE, np.int8)
    cells[:, 30] = OCCUPIED
    world, lidar = world_of(cells), Lidar(AROUND)
    disc, hidden = [24.0, 21.0, 2.0], [35.0, 20.0, 2.0]
    plain = lidar.scan(world, (20.5, 20.5, 0.3)).ranges
    got = lidar.scan(world, (20.5, 20.5, 0.3), discs=np.array([disc, hidden])).ranges
    angles = 0.3 + AROUND.angle_min + AROUND.angle_increment * np.arange(AROUND.beams)
    met = got < plain
    ends = np.array([20.5, 20.5]) + got[met, None] * np.stack(
        [np.cos(angles[met]), np.sin(angles[met])], axis=1
    )
    assert np.hypot(*(ends - disc[:2]).T) == pytest.approx(2.0, abs=1e-9)
    assert np.array_equal(got[~met], plain[~met], equal_nan=True)
    # As many beams as the circle's angle takes.
    wide = 2 * math.asin(2.0 / math.hypot(3.5, 0.5))
    assert met.sum() == pytest.approx(wide / AROUND.angle_increment, abs=1)


def room_of_nine_metres():
    cells = np.full((11, 11), FREE, np.int8)
    cells[:, [0, -1]] = cells[[0, -1], :] = OCCUPIED
    return world_of(cells)


def test_noise_never_makes_a_range_negative_or_too_long_for_the_sensor():
    world = room_of_nine_metres()
    noisy = Lidar(LidarConfig(beams=720, range_max=5.0, range_noise=3.0, mount=(0, 0, 0)))
    exact = Lidar(LidarConfig(beams=720, range_max=5.0, mount=(0, 0, 0)))
    ranges = noisy.scan(world, (5.5, 5.5, 0.0), np.random.default_rng(0)).ranges
    returned = np.isfinite(exact.scan(world, (5.5, 5.5, 0.0)).ranges)
    assert ranges[returned].min() == 0.0
    assert 4.99 < ranges[returned].max() < 5.0
    assert np.isinf(ranges[~returned]).all()


def test_a_disc_is_met_ahead_alone_and_only_within_range():
    world, lidar = room_of_nine_metres(), Lidar(LidarConfig(beams=3, fov=0.01, mount=(0, 0, 0)))
    pose = (5.5, 5.5, 0.0)
    behind = np.array([[3.0, 5.5, 0.5]])
    assert np.array_equal(
        lidar.scan(world, pose, discs=behind).ranges, lidar.scan(world, pose).ranges
    )
    # A sensor that stands in a disc measures nothing less than 0.
    ahead = np.array([[5.6, 5.5, 0.5]])
    assert (lidar.scan(world, pose, discs=ahead).ranges == 0.0).all()
    short = Lidar(LidarConfig(beams=3, fov=0.01, range_max=2.0, mount=(0, 0, 0)))
    far = np.array([[8.5, 5.5, 0.5]])
    assert np.isinf(short.scan(world, pose, discs=far).ranges).all()


def test_a_beam_that_says_nothing_says_nothing_of_discs():
    cells = np.full((11, 11), FREE, np.int8)
    cells[:, 9:] = UNKNOWN
    lidar = Lidar(LidarConfig(beams=3, fov=0.01, mount=(0, 0, 0)))
    disc = np.array([[7.0, 5.5, 0.5]])
    assert np.isnan(lidar.scan(world_of(cells), (2.5, 5.5, 0.0), discs=disc).ranges).all()
