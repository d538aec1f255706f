"""The laws of the MPC: limits, safety, derivatives, and what it does where it cannot go on."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foresee.mapping.car_limits import CarLimits, DrivingLimits
from foresee.mapping.control import Control
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from planner.motion.dynamics import rollout
from planner.motion.path import Path
from planner.mpc.initial_guess import shifted, stop_controls
from planner.mpc.mpc import MPC, Solution, Status
from planner.mpc.stages import stage_functions
from planner.risk.risk_map import RiskMap
from planner.safety.collision import CollisionChecker
from sim import DubinsCar

CAR = CarLimits()
DT = 0.1
CHECKER = CollisionChecker(CAR, DT)
N_CELLS = 240
FRAME = GridFrame(0.05, (-2.0, -6.0), (N_CELLS, N_CELLS))
LIMITS = CAR.driving._replace(cornering=CAR.lateral_acceleration)

speeds = st.floats(0.0, CAR.v_max)
seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def mpc() -> MPC:
    return MPC(CAR)


def corridor(width: float = 2.4, end: float = 9.0, beyond: int = OCCUPIED) -> RiskMap:
    """A corridor along x, free up to `end` [m] and then `beyond`."""
    x, y = FRAME.centres()
    cells = np.full(FRAME.shape, OCCUPIED, np.int8)
    cells[abs(y) < width / 2] = FREE
    cells[np.ix_(abs(y) < width / 2, x >= end)] = beyond
    return RiskMap.from_prediction(Grid(FRAME, cells), None, 0.0)


def room() -> RiskMap:
    return RiskMap.from_prediction(Grid(FRAME, np.full(FRAME.shape, FREE, np.int8)), None, 0.0)


def ahead(length: float = 30.0) -> Path:
    return Path.through(np.array([[-1.0, 0.0], [length, 0.0]]), "ompl")


def bend() -> Path:
    """Straight on, then a quarter to the left and on."""
    turn = np.linspace(-math.pi / 2, 0.0, 12)
    corner = np.column_stack([3.0 + 1.2 * np.cos(turn), 1.2 + 1.2 * np.sin(turn)])
    return Path.through(np.vstack([[[-1.0, 0.0]], corner, [[4.2, 5.0]]]), "ompl")


def drive(
    mpc: MPC,
    state,
    path: Path,
    risk: RiskMap,
    ticks: int,
    found: list[tuple[Solution, Solution]] | None = None,
):
    """Plan after plan, each from where the one before led to.

    Args:
        mpc: the solver.
        state: where the drive begins.
        path: to follow.
        risk: to keep to.
        ticks: plans.
        found: is given each solution, and what a second solve makes of its plan.
    """
    controls = stop_controls(mpc.stages, CAR.braking, 0.0)
    curvature = 0.0
    for _ in range(ticks):
        segment = max(0, round((state[0] + 1.0) / 0.1)) if path.points[-1, 1] == 0 else 0
        solved = mpc.solve(np.asarray(state, float), path, risk, controls, segment, curvature)
        plan = solved.plan
        if found is not None:
            again = mpc.solve(plan.states[0], path, risk, plan.controls, segment, curvature)
            found.append((solved, again))
        yield plan
        state, curvature = plan.states[1], float(plan.controls[0, 1])
        controls = shifted(plan.controls, CAR.braking)


def assert_within_limits(plan, car: CarLimits, v_top: float | None = None) -> None:
    tiny = 1e-6
    v, (a, kappa) = plan.states[:, 3], plan.controls.T
    assert a.max() <= car.acceleration + tiny
    assert a.min() >= -car.braking - tiny
    assert abs(kappa).max() <= car.max_curvature + tiny
    assert v.min() >= 0.0
    assert v.max() <= (v_top or car.v_max) + tiny
    fastest = np.maximum(v[:-1], v[1:])
    assert (fastest**2 * abs(kappa)).max() <= car.lateral_acceleration + tiny


@pytest.mark.parametrize("speed", [0.0, 1.0, 2.5, 4.0])
@pytest.mark.parametrize("offset", [-0.5, 0.0, 0.4])
def test_every_plan_ends_stopped_and_inside_the_safe_set(mpc, speed, offset):
    risk = corridor()
    state = np.array([0.0, offset, 0.0, speed])
    for plan in drive(mpc, state, ahead(), risk, 8):
        assert plan.states[-1, 3] == pytest.approx(0.0, abs=1e-3)
        assert CHECKER.is_safe(plan, risk)


@given(speeds, st.floats(-0.8, 0.8), st.floats(-0.5, 0.5), seeds, st.booleans())
@settings(max_examples=30)
def test_no_plan_passes_the_limits_of_the_car(mpc, speed, offset, yaw, seed, turns):
    rng = np.random.default_rng(seed)
    guess = rng.normal(0.0, 2.0, (mpc.stages, 2))
    path, risk = (bend(), room()) if turns else (ahead(), corridor())
    plan = mpc.solve(np.array([0.0, offset, yaw, speed]), path, risk, guess).plan
    assert_within_limits(plan, CAR)


@given(speeds, st.floats(-0.8, 0.8), st.floats(-0.5, 0.5), seeds, st.floats(0.0, 3.0))
@settings(max_examples=30)
def test_a_solve_never_raises_the_cost_of_its_guess(mpc, speed, offset, yaw, seed, size):
    guess = np.random.default_rng(seed).normal(0.0, size, (mpc.stages, 2))
    state, path, risk = np.array([0.0, offset, yaw, speed]), ahead(), corridor()
    before = mpc.evaluate(mpc.roll(state, guess), path, risk, 0, 0.2)
    found = mpc.solve(state, path, risk, guess, 0, 0.2)
    assert found.cost <= before
    assert found.cost == pytest.approx(mpc.evaluate(found.plan, path, risk, 0, 0.2))


def test_a_solve_lowers_the_cost_of_standing_still(mpc):
    state, path, risk = np.zeros(4), ahead(), corridor()
    guess = stop_controls(mpc.stages, CAR.braking, 0.0)
    before = mpc.evaluate(mpc.roll(state, guess), path, risk, 10, 0.0)
    assert mpc.solve(state, path, risk, guess, 10).cost < before - 1.0


@pytest.mark.parametrize("speed", [0.0, 1.0, 2.0, 4.0])
@pytest.mark.parametrize(
    ("risk", "path"), [(corridor(), ahead()), (corridor(1.2), ahead()), (room(), bend())]
)
def test_a_converged_plan_leaves_little_to_gain(mpc, speed, risk, path):
    found: list[tuple[Solution, Solution]] = []
    assert len(list(drive(mpc, np.array([0.0, 0.1, 0.1, speed]), path, risk, 8, found))) == 8
    for first, second in found:
        assert first.status is Status.CONVERGED
        assert first.cost - second.cost < 2e-3 * (1.0 + abs(first.cost))


@given(seeds)
@settings(max_examples=25)
def test_the_stage_derivatives_agree_with_finite_differences(seed):
    rng = np.random.default_rng(seed)
    effort = rng.uniform(0.0, 1.0, 2)
    stage = stage_functions(DT, 1, effort)
    z = np.concatenate(
        [
            rng.uniform(-5, 5, 2),
            rng.uniform(-3, 3, 1),
            rng.uniform(0.3, 4, 1),
            rng.uniform(-1.5, 1.5, 1),
            rng.uniform(-1.25, 1.25, 1),
        ]
    )
    multiplier, reference = rng.normal(size=4), rng.normal(size=9)

    def successor(z):
        # Without limits: one step of the closed form.
        return rollout(z[:4], z[None, 4:], DT, DrivingLimits(1e3, 1e3, 1e3, 1e9, 1e3))[0][1]

    def cost(z):
        r = reference
        off = z[:2] - r[:2]
        m = np.array([[r[4], r[5]], [r[5], r[6]]])
        turned = r[8] * (1 - math.cos(z[2] - r[7]))
        return r[2:4] @ off + 0.5 * off @ m @ off + turned + effort @ z[4:] ** 2

    def lagrangian_gradient(z):
        jacobian, gradient, _ = (np.array(part) for part in stage(z, multiplier, reference))
        return gradient[:, 0] + jacobian.T @ multiplier

    jacobian, gradient, hessian = (np.array(part) for part in stage(z, multiplier, reference))
    assert jacobian == pytest.approx(differences(successor, z), abs=1e-6)
    assert gradient[:, 0] == pytest.approx(differences(cost, z)[0], abs=1e-6)
    assert hessian == pytest.approx(differences(lagrangian_gradient, z), abs=1e-6)
    assert hessian == pytest.approx(hessian.T, abs=1e-12)


def differences(function, z, step: float = 1e-5):
    """The Jacobian by central differences, (outputs, inputs)."""
    columns = []
    for i in range(len(z)):
        e = step * np.eye(len(z))[i]
        columns.append(np.atleast_1d((function(z + e) - function(z - e)) / (2 * step)))
    return np.column_stack(columns)


@given(seeds, speeds)
def test_a_plan_is_rolled_out_as_the_simulated_car_drives_it(seed, speed):
    rng = np.random.default_rng(seed)
    controls = np.column_stack([rng.uniform(-3, 3, 20), rng.uniform(-2, 2, 20)])
    state = np.array([*rng.uniform(-5, 5, 2), rng.uniform(-3, 3), speed])
    states, applied = rollout(state, controls, DT, LIMITS)
    car = DubinsCar(CarLimits())
    for k, control in enumerate(applied):
        reached = car.step(states[k], Control(*control), DT)
        assert reached[[0, 1, 3]] == pytest.approx(states[k + 1, [0, 1, 3]], abs=1e-9)
        turned = math.remainder(reached[2] - states[k + 1, 2], 2 * math.pi)
        assert turned == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("excess", [0.001, 0.1, 0.7])
def test_a_car_measured_above_its_top_speed_still_has_a_plan(mpc, excess):
    speed = CAR.v_max + excess
    state, risk = np.array([0.0, 0.0, 0.0, speed]), corridor(end=9.9)
    guess = stop_controls(mpc.stages, CAR.braking, 0.0)
    plan = mpc.solve(state, ahead(), risk, guess, 10).plan
    assert_within_limits(plan, CAR, v_top=speed)
    assert plan.states[-1, 3] == pytest.approx(0.0, abs=1e-3)
    assert CHECKER.is_safe(plan, risk)


@pytest.mark.parametrize("beyond", [OCCUPIED, UNKNOWN])
@pytest.mark.parametrize("end", [1.5, 3.0, 6.0])
def test_the_car_stops_before_what_bars_the_way_and_close_to_it(mpc, end, beyond):
    risk = corridor(end=end, beyond=beyond)
    for plan in drive(mpc, np.zeros(4), ahead(), risk, 70):
        assert CHECKER.is_safe(plan, risk)
    nose = plan.states[0, 0] + CAR.body.half_length
    assert end - 0.7 < nose < end
    assert plan.states[0, 3] < 0.1


def test_a_wall_that_is_too_close_makes_no_plan_safe(mpc):
    risk = corridor(end=2.0)
    state = np.array([0.0, 0.0, 0.0, 4.0])
    guess = stop_controls(mpc.stages, CAR.braking, 0.0)
    plan = mpc.solve(state, ahead(), risk, guess, 10).plan
    assert not CHECKER.is_safe(plan, risk)
    assert_within_limits(plan, CAR)


def test_a_plan_that_does_not_end_stopped_is_not_safe(mpc):
    plan = mpc.roll(np.array([0.0, 0.0, 0.0, 0.5]), np.zeros((mpc.stages, 2)))
    assert not CHECKER.is_safe(plan, room())


@pytest.mark.parametrize("i", range(4))
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_state_that_is_not_finite_is_refused(mpc, i, value):
    state = np.zeros(4)
    state[i] = value
    with pytest.raises(ValueError, match="finite"):
        mpc.solve(state, ahead(), room(), np.zeros((mpc.stages, 2)))


def test_a_guess_that_is_not_finite_is_refused(mpc):
    with pytest.raises(ValueError, match="finite"):
        mpc.solve(np.zeros(4), ahead(), room(), np.full((mpc.stages, 2), math.nan))


def test_the_horizon_holds_a_full_stop():
    for v_max, braking in [(4.0, 1.5), (1.0, 0.5), (6.0, 1.2)]:
        mpc = MPC(CarLimits(v_max=v_max, braking=braking))
        assert mpc.stages * mpc.config.dt > v_max / braking + 0.4


def test_an_empty_straight_is_driven_at_top_speed():
    mpc = MPC(CAR)
    frame = GridFrame(0.1, (-2.0, -2.0), (40, 640))
    risk = RiskMap.from_prediction(Grid(frame, np.full(frame.shape, FREE, np.int8)), None, 0.0)
    fastest = 0.0
    for plan in drive(mpc, np.zeros(4), ahead(60.0), risk, 60):
        assert_within_limits(plan, CAR)
        fastest = max(fastest, plan.states[0, 3])
    assert fastest >= 0.95 * CAR.v_max


@given(st.floats(0.0, 3.0), st.floats(-0.4, 0.4), st.floats(-0.3, 0.3))
@settings(max_examples=20)
def test_mirrored_problems_have_mirrored_plans(mpc, speed, offset, yaw):
    risk, path = corridor(), ahead()
    guess = stop_controls(mpc.stages, CAR.braking, 0.0)
    left = mpc.solve(np.array([0.0, offset, yaw, speed]), path, risk, guess, 10)
    right = mpc.solve(np.array([0.0, -offset, -yaw, speed]), path, risk, guess, 10)
    assert left.cost == pytest.approx(right.cost, rel=1e-3, abs=1e-3)
