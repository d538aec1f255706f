import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foresee.mapping.body import Body
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.control import Control
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from sim.car import DubinsCar, collides
from sim.lidar import Lidar, LidarConfig
from sim.world import World

CAR = DubinsCar()
TWO_GEARS = DubinsCar(CarLimits(reverse=0.5))
state = st.tuples(
    st.floats(-50, 50), st.floats(-50, 50), st.floats(-math.pi, math.pi), st.floats(0, 4)
)
control = st.builds(Control, st.floats(-5, 5), st.floats(-5, 5))
interval = st.floats(0, 2)


def same_pose(a: np.ndarray, b: np.ndarray) -> bool:
    turn = math.remainder(a[2] - b[2], 2 * math.pi)
    return bool(np.allclose(a[:2], b[:2], atol=1e-9) and abs(turn) < 1e-9)


def walled(size: int = 80) -> World:
    cells = np.full((size, size), FREE, dtype=np.int8)
    cells[:, [0, -1]] = cells[[0, -1], :] = OCCUPIED
    return World("walled", Grid(GridFrame(0.05, (-1.0, -2.0), (size, size)), cells))


@given(state, control, interval)
def test_speed_stays_between_zero_and_v_max(state, control, dt):
    v = CAR.step(state, control, dt)[3]
    assert 0 <= v <= CAR.limits.v_max + 1e-12


@given(state, control, interval)
def test_yaw_stays_in_its_half_open_circle(state, control, dt):
    assert -math.pi < CAR.step(state, control, dt)[2] <= math.pi


@given(state, control, interval)
def test_the_limits_of_acceleration_and_of_cornering_hold(state, control, dt):
    x, y, yaw, v = state
    end = CAR.step(state, control, dt)
    config = CAR.limits
    assert -config.braking * dt - 1e-9 <= end[3] - v <= config.acceleration * dt + 1e-9
    poses = CAR.motion(state, control, dt, 0.05)
    length = math.hypot(end[0] - x, end[1] - y)
    turned = abs(math.remainder(end[2] - yaw, 2 * math.pi))
    if length > 1e-3 and turned < 1.0:
        curvature = 2 * math.sin(turned / 2) / length
        assert curvature <= config.max_curvature * (1 + 1e-6)
        assert curvature * max(v, end[3]) ** 2 <= config.lateral_acceleration * (1 + 1e-6)
    assert same_pose(poses[-1], end)


@given(state, st.builds(Control, st.floats(-5, 5), st.floats(-0.15, 0.15)), interval)
def test_one_step_equals_two_half_steps(state, control, dt):
    # Curvature below the lateral limit at top speed, which else differs between the two halves.
    whole = CAR.step(state, control, dt)
    halves = CAR.step(CAR.step(state, control, dt / 2), control, dt / 2)
    assert same_pose(whole, halves)
    assert whole[3] == pytest.approx(halves[3], abs=1e-9)


@given(state, control, interval)
@settings(max_examples=30)
def test_the_closed_form_is_the_limit_of_small_euler_steps(state, control, dt):
    end = CAR.step(state, control, dt)
    # What the limits leave of the control, read back from a short arc.
    v_top = max(state[3], end[3])
    tightest = min(CAR.limits.max_curvature, 3.0 / max(v_top, 1e-9) ** 2)
    kappa = float(np.clip(control.curvature, -tightest, tightest))
    a = float(np.clip(control.acceleration, -1.5, 1.5))
    x, y, yaw, v = state
    n = 2000
    for _ in range(n):
        v_mid = min(max(v + a * dt / n / 2, 0.0), 4.0)
        yaw_mid = yaw + kappa * v_mid * dt / n / 2
        x, y = x + v_mid * math.cos(yaw_mid) * dt / n, y + v_mid * math.sin(yaw_mid) * dt / n
        yaw += kappa * v_mid * dt / n
        v = min(max(v + a * dt / n, 0.0), 4.0)
    assert np.hypot(x - end[0], y - end[1]) < 1e-4
    assert v == pytest.approx(end[3], abs=1e-9)


def test_full_lock_drives_a_circle_of_the_turning_radius():
    state = np.array([0.0, 0.0, 0.0, 1.0])
    circumference = 2 * math.pi * CAR.limits.turning_radius
    poses = CAR.motion(state, Control(0.0, 99.0), circumference, 0.01)
    radii = np.hypot(poses[:, 0], poses[:, 1] - 0.8)
    assert np.allclose(radii, 0.8, atol=1e-12)
    assert np.allclose(poses[-1], [0, 0, 0], atol=1e-9)


def test_a_braking_car_stops_within_its_stopping_distance_and_stays():
    end = CAR.step((0, 0, 0, 3.0), Control(-1.5, 0.0), 60.0)
    assert end[3] == 0
    assert end[0] == pytest.approx(3.0**2 / (2 * 1.5), abs=1e-12)
    assert np.array_equal(CAR.step(end, Control(-1.5, 1.0), 1.0), end)


@given(state, control, st.floats(0.01, 1), st.floats(0.005, 0.2))
@settings(max_examples=50)
def test_no_corner_moves_further_than_the_spacing(state, control, dt, spacing):
    poses = np.vstack([state[:3], CAR.motion(state, control, dt, spacing)])
    body = CAR.limits.body
    corners = np.array(
        [[sx * body.half_length, sy * body.half_width] for sx in (-1, 1) for sy in (-1, 1)]
    )
    cos, sin = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
    xs = poses[:, :1] + cos * corners[:, 0] - sin * corners[:, 1]
    ys = poses[:, 1:2] + sin * corners[:, 0] + cos * corners[:, 1]
    assert np.hypot(np.diff(xs, axis=0), np.diff(ys, axis=0)).max(initial=0) <= spacing + 1e-9


@given(state, control, interval)
def test_a_reverse_gear_changes_nothing_about_driving_forwards(state, control, dt):
    end = CAR.step(state, control, dt)
    assert np.array_equal(TWO_GEARS.step(state, control, dt), end)
    assert np.array_equal(TWO_GEARS.step(state, replace(control, gear=1), dt), end)
    poses = CAR.motion(state, control, dt, 0.05)
    assert np.array_equal(TWO_GEARS.motion(state, replace(control, gear=1), dt, 0.05), poses)


@given(state, control, interval)
def test_driving_backwards_mirrors_driving_forwards(state, control, dt):
    # The same drive seen by someone who faces the other way: left and right change places.
    slow = DubinsCar(CarLimits(v_max=TWO_GEARS.limits.reverse))
    x, y, yaw, v = state
    v = min(v, slow.limits.v_max)
    back = TWO_GEARS.step((x, y, yaw, -v), replace(control, gear=-1), dt)
    faced = slow.step((x, y, yaw + math.pi, v), replace(control, curvature=-control.curvature), dt)
    assert same_pose(back, faced + np.array([0, 0, math.pi, 0]))
    assert back[3] == -faced[3]


@given(state, control, interval, st.sampled_from([1, -1]))
def test_each_gear_has_its_top_speed(state, control, dt, gear):
    v = TWO_GEARS.step((*state[:3], 0.0), replace(control, gear=gear), dt)[3]
    assert 0 <= gear * v <= (4.0 if gear > 0 else 0.5)


@given(state, control, interval, st.sampled_from([1, -1]))
def test_a_car_that_moves_stays_in_its_gear(state, control, dt, gear):
    x, y, yaw, v = state
    for speed in (v + 0.01, -(v + 0.01) / 10):
        moved = TWO_GEARS.step((x, y, yaw, speed), replace(control, gear=gear), dt)
        own = TWO_GEARS.step((x, y, yaw, speed), replace(control, gear=1 if speed > 0 else -1), dt)
        assert np.array_equal(moved, own)
        assert moved[3] * speed >= 0


def test_a_car_backs_up_only_after_it_has_come_to_rest():
    state = np.array([0.0, 0.0, 0.0, 0.3])
    state = TWO_GEARS.step(state, Control(-1.5, 0, -1), 1.0)
    assert state[3] == 0
    assert math.copysign(1, TWO_GEARS.step(state, Control(-1.5, 0, -1), 1.0)[3]) == 1
    back = TWO_GEARS.step(state, Control(1.0, 0.5, -1), 0.4)
    assert back[3] == pytest.approx(-0.4)
    assert back[0] < state[0]
    assert back[2] < 0  # Curvature to the left: backwards the yaw falls.
    assert TWO_GEARS.step(back, Control(-1.5, 0), 5.0)[3] == 0


def test_a_rounding_error_of_the_speed_does_not_hold_the_gear():
    for v in (2e-16, -2e-16):
        for gear in (1, -1):
            assert TWO_GEARS.step((0, 0, 0, v), Control(1.0, 0, gear), 0.1)[3] == pytest.approx(
                0.1 * gear
            )


def test_a_car_that_backs_into_a_wall_has_collided():
    world = walled()
    state = (-0.5, 0.0, 0.0, 0.0)
    assert not TWO_GEARS.collides(world, state, Control(1.5, 0, 1), 1.0)
    assert TWO_GEARS.collides(world, state, Control(1.5, 0, -1), 1.0)


@given(state, control, st.floats(0.01, 1), st.floats(0.005, 0.2))
@settings(max_examples=30)
def test_poses_along_a_motion_backwards_end_where_the_step_does(state, control, dt, spacing):
    state = (*state[:3], -state[3] / 8)
    poses = TWO_GEARS.motion(state, replace(control, gear=-1), dt, spacing)
    assert same_pose(poses[-1], TWO_GEARS.step(state, replace(control, gear=-1), dt))
    moves = np.diff(np.vstack([state[:3], poses]), axis=0)
    assert np.hypot(*moves[:, :2].T).max() <= spacing + 1e-9


def test_a_car_that_flies_through_a_thin_wall_in_one_step_has_collided():
    world = walled(200)
    cells = world.grid.cells.copy()
    cells[:, 100] = OCCUPIED
    thin = World("thin", Grid(world.grid.frame, cells))
    start = (2.0, 1.0, 0.0, 4.0)
    assert not DubinsCar().collides(world, start, Control(0, 0), 1.0)
    assert DubinsCar().collides(thin, start, Control(0, 0), 1.0)
    assert not collides(thin, [CAR.step(start, Control(0, 0), 1.0)[:3]], Body())


def test_the_wall_that_rays_meet_is_the_wall_that_the_body_meets():
    world = walled()
    lidar = Lidar(LidarConfig(fov=0.01, beams=3, mount=(0, 0, 0)))
    for yaw in (0.0, math.pi / 2, math.pi, -math.pi / 2):
        ahead = lidar.scan(world, (0.7, -0.4, yaw)).ranges[1] - Body().half_length
        pose = np.array([0.7, -0.4, yaw])
        for gap, meets in ((1e-6, False), (-1e-6, True)):
            moved = pose + (ahead - gap) * np.array([math.cos(yaw), math.sin(yaw), 0])
            assert collides(world, moved, Body()) == meets


def test_outside_the_map_is_solid():
    free = World("free", Grid(GridFrame(0.05, (0, 0), (40, 40)), np.zeros((40, 40), np.int8)))
    assert not collides(free, (1, 1, 0), Body())
    assert collides(free, (1.9, 1, 0), Body())
    assert collides(free, (9, 9, 0), Body())


def test_misuse_says_what_is_wrong():
    with pytest.raises(ValueError, match="finite"):
        CAR.step((0, 0, math.nan, 1), Control(0, 0), 0.1)
    with pytest.raises(ValueError, match="negative"):
        CAR.step((0, 0, 0, -1), Control(0, 0), 0.1)
    with pytest.raises(ValueError, match="spacing"):
        CAR.motion((0, 0, 0, 1), Control(0, 0), 0.1, 0.0)
    with pytest.raises(ValueError, match="braking"):
        CarLimits(braking=0)
    with pytest.raises(ValueError, match="reverse"):
        CarLimits(reverse=-0.5)
    for gear in (0, 2, math.nan):
        with pytest.raises(ValueError, match="gear is"):
            TWO_GEARS.step((0, 0, 0, 0), Control(0, 0, gear), 0.1)
    for speed in (0, 1):
        with pytest.raises(ValueError, match="gear is -1, but the car has no reverse gear"):
            CAR.step((0, 0, 0, speed), Control(0, 0, -1), 0.1)


@given(st.floats(-3, 3), st.floats(-2, 2), st.floats(0, 3))
def test_the_papers_car_drives_the_same_arc_as_the_other(yaw, v, dt):
    # The paper's car has state [x, y, θ] and control [v, dθ/dt] (Katyal et al. 2018).
    v = abs(v) + 0.1
    turn = 0.3 * v
    end = yaw + turn * dt
    x = 1 + v / turn * (math.sin(end) - math.sin(yaw))
    y = 2 - v / turn * (math.cos(end) - math.cos(yaw))
    assert same_pose((x, y, end), CAR.step((1, 2, yaw, v), Control(0, 0.3), dt)[:3])


@pytest.mark.parametrize("side", [1, -1])
def test_a_wall_that_a_swinging_corner_enters_by_a_fifth_of_a_millimetre_is_hit(side):
    car, dt = DubinsCar(), 0.1
    body = car.limits.body
    state, control = (0.0, 0.0, 0.0, 1.0), Control(0.0, side * car.limits.max_curvature)
    back, out = body.half_length - 2e-4, body.half_width - 2e-4
    cells = np.full((60, 60), FREE, np.int8)
    cells[30, 30] = OCCUPIED
    # Its first centimetre belongs to the end of the step before, which was tested too.
    for x, y, yaw in car.motion(state, control, dt, 5e-4)[20:]:
        # The rear corner on the outside of the turn.
        px = x - back * math.cos(yaw) + side * out * math.sin(yaw)
        py = y - back * math.sin(yaw) - side * out * math.cos(yaw)
        # The corner of a cell of 5 cm that lies outside and behind.
        frame = GridFrame(0.05, (px - 31 * 0.05, py - (31 if side > 0 else 30) * 0.05), (60, 60))
        assert car.collides(World("cell", Grid(frame, cells)), state, control, dt)


def test_a_car_that_passes_a_wall_at_two_centimetres_has_not_collided():
    world = walled()
    # The lower wall's upper side is at y = -1.95 m.
    for gap, hit in ((0.02, False), (-0.001, True)):
        state = (0.0, -1.95 + Body().half_width + gap, 0.0, 2.0)
        assert CAR.collides(world, state, Control(0.0, 0.0), 0.5) == hit


def test_a_car_that_drives_into_what_no_map_tells_has_collided():
    world = walled()
    cells = world.grid.cells.copy()
    cells[:, 50:] = UNKNOWN
    dark = World("dark", Grid(world.grid.frame, cells))
    assert not CAR.collides(world, (0.5, 0.0, 0.0, 2.0), Control(0.0, 0.0), 0.5)
    assert CAR.collides(dark, (0.5, 0.0, 0.0, 2.0), Control(0.0, 0.0), 0.5)
