"""Every plan that is driven was found safe on the newest map, whatever its maker says."""

import dataclasses

import numpy as np
import pytest
from short_drive import LIDAR, navigator, straight

from foresee.mapping.body import covered
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from foresee.prediction import Prediction
from planner.fault import Fault
from planner.motion.path import Path
from planner.mpc.mpc import Solution, Status
from planner.navigator_config import NavigatorConfig
from planner.risk.risk_map import RiskMap
from planner.safety.plan_choice import PlanChooser
from planner.safety.situation import Situation
from sim import DubinsCar
from sim.world import World


def test_a_solver_that_plans_into_a_wall_and_reports_success_is_not_followed():
    task, car = straight(), DubinsCar()
    driver = navigator(task)
    mpc = driver.chooser.mpc

    def solve(state, *_):
        controls = np.tile([-mpc.limits.braking, 0.0], (mpc.stages, 1))
        controls[:12] = 1.0, 0.5
        return Solution(mpc.roll(state, controls), 0.0, Status.CONVERGED)

    mpc.solve = solve
    state = np.array([*task.start, 0.0])
    for _ in range(40):
        decision = driver.step(state, LIDAR.scan(task.world, state))
        assert not decision.emergency
        assert driver.chooser.checker.is_safe(decision.plan, decision.risk_map)
        assert not car.collides(task.world, state, decision.control, 0.1)
        state = car.step(state, decision.control, 0.1)
    assert driver.faults["no_safe_solution"] > 10


def test_a_wall_that_appears_too_near_to_stop_is_an_emergency():
    task, car = straight(), DubinsCar()
    driver = navigator(task)
    state = np.array([*task.start, 0.0])
    for _ in range(15):
        decision = driver.step(state, LIDAR.scan(task.world, state))
        state = car.step(state, decision.control, 0.1)
    assert state[3] > 1.0
    grid = task.world.grid
    cells, (x, _) = grid.cells.copy(), grid.frame.centres()
    ahead = x - state[0] - car.limits.body.half_length
    cells[:, (ahead > 0.7) & (ahead < 0.9)] = OCCUPIED
    blocked = World("blocked", Grid(grid.frame, cells))
    # It takes three scans until cells that were seen free count as occupied.
    for _ in range(3):
        decision = driver.step(state, LIDAR.scan(blocked, state))
        state = car.step(state, decision.control, 0.1)
    assert decision.emergency
    assert not driver.chooser.checker.is_safe(decision.plan, decision.risk_map)
    assert decision.control.acceleration == -car.limits.braking


def into_the_unobserved(p_free=1.0):
    """A car in a hall of which the first 2 m ahead are observed, and what is predicted of the rest
    is p_free."""
    frame = GridFrame(0.05, (-4.0, -4.0), (160, 240))
    cells = np.full(frame.shape, FREE, np.int8)
    cells[:, frame.centres()[0] > 2.0] = UNKNOWN
    ones = np.ones(frame.shape, np.float32)
    belief = Prediction(frame, p_free * ones, (1.0 - p_free) * ones, ones)
    risk = RiskMap.from_prediction(Grid(frame, cells), belief, 0.1)
    path = Path.through(np.array([[0.0, 0.0], [7.0, 0.0]]), "route")
    return Situation(np.array([0.0, 0.0, 0.0, 1.5]), risk, path, 0, False)


def test_a_cautious_plan_lies_in_certain_cells():
    now, chooser = into_the_unobserved(), navigator(straight()).chooser
    plan = chooser._cautious(now, None, [])
    assert chooser.checker.is_safe(plan, now.risk.cautious)
    assert plan.states[-1, 0] > 1.3


def test_a_cautious_plan_starts_from_the_rest_of_the_last_ticks():
    now, chooser = into_the_unobserved(), navigator(straight()).chooser
    # As if no step of the plan could be followed, so that there is a cautious plan in each tick.
    chooser.resort._foreseen = lambda *args: None
    guesses = []
    solve = chooser.mpc.solve

    def records(state, path, risk, guess, *others):
        if risk.plan_suffices:
            guesses.append(guess)
        return solve(state, path, risk, guess, *others)

    chooser.mpc.solve = records
    chooser.choose(now, True)
    last = chooser._last_cautious
    chooser.choose(now, False)
    np.testing.assert_array_equal(guesses[1][:-1], last.controls[1:])
    # Neither a fresh start nor a tick without a cautious plan leaves one to start from.
    chooser.choose(now, True)
    assert not np.array_equal(guesses[2], guesses[1])
    chooser.resort._foreseen = lambda *args: 0
    chooser.choose(now, False)
    assert chooser._last_cautious is None


@pytest.mark.parametrize("changes", [{"on_leg": True}, {"path": None}])
def test_without_a_path_and_on_a_leg_there_is_no_cautious_plan(changes):
    now = dataclasses.replace(into_the_unobserved(), **changes)
    assert navigator(straight()).chooser._cautious(now, None, []) is None


def test_a_slow_car_does_not_stop_because_it_cannot_go_on_from_its_plan():
    there = into_the_unobserved()
    now = dataclasses.replace(there, state=np.array([0.0, 0.0, 0.0, 0.15]))
    chooser = navigator(straight()).chooser
    chooser.goes_on = lambda plan, risk: plan.states[-1, 0] < 0.1
    chooser._stopping_sooner = lambda *args: (None, ())
    assert chooser.choose(now, True).intended.states[-1, 0] > 1.0
    # At speed, it swerves or brakes to where it can go on.
    chooser.goes_on = lambda plan, risk: plan.states[-1, 0] < 1.0
    assert chooser.choose(there, True).intended.states[-1, 0] < 1.0


def test_a_failure_of_the_solver_in_the_cautious_plan_is_counted():
    now, chooser = into_the_unobserved(), navigator(straight()).chooser
    solve = chooser.mpc.solve

    def fails_cautiously(state, path, risk, *others):
        if risk.plan_suffices:
            raise RuntimeError("no solution")
        return solve(state, path, risk, *others)

    chooser.mpc.solve = fails_cautiously
    chooser.resort._foreseen = lambda *args: None
    assert Fault.SOLVER_FAILED in chooser.choose(now, True).faults


@pytest.mark.parametrize("relies", [True, False])
def test_predicted_walls_bar_the_way_on_only_of_a_plan_that_relies_on_predictions(relies):
    now, chooser = into_the_unobserved(0.0), navigator(straight()).chooser
    # It ends 0.3 m before the predicted wall; one cell under the body was perhaps not observed.
    state = np.array([1.45, 0.0, 0.0, 0.0])
    plan = chooser.mpc.roll(state, np.zeros((chooser.mpc.stages, 2)))
    cells = now.risk.known.cells.copy()
    if relies:
        cells[80, 108] = UNKNOWN
    risk = dataclasses.replace(now.risk, known=Grid(now.risk.frame, cells))
    assert not chooser.checker.leads_on(state, risk.barred, risk.frame)
    assert chooser.goes_on(plan, risk) == (not relies)


@pytest.mark.parametrize("missed", [0, 1, 2])
def test_the_rest_of_the_last_plan_is_driven_on_where_nothing_else_is_free(missed):
    frame, config = GridFrame(0.05, (0.0, 0.0), (240, 240)), NavigatorConfig()
    angles = np.linspace(0.0, 0.5 * np.pi, 60)
    bend = np.column_stack([4.0 + 2.0 * np.sin(angles), 5.0 - 2.0 * np.cos(angles)])
    path = Path.through(np.vstack([[1.0, 3.0], bend, [6.0, 9.0]]), "route")
    state = np.array([3.0, 3.0, 0.0, 2.2])
    segment = int(np.argmin(np.hypot(*(path.points - state[:2]).T)))
    chooser = PlanChooser(config.car, config.mpc, (50.0, 5.0), config.window)
    free = RiskMap.from_prediction(Grid(frame, np.full(frame.shape, FREE, np.int8)), None, 0.0)
    plan = chooser.choose(Situation(state, free, path, segment, False), True).plan
    cells = np.full(frame.shape, OCCUPIED, np.int8)
    for pose in plan.poses(config.mpc.dt, 0.02):
        body = config.car.body.inflated(0.03)
        cells[tuple(covered(frame.shape, *frame.lattice, *pose, *body.halves).T)] = FREE
    tight = RiskMap.from_prediction(Grid(frame, cells), None, 0.0)
    state = plan.states[1]
    for _ in range(missed):
        kept = chooser.kept.copy()
        assert (chooser.skip() == kept[0]).all()
        state = chooser.mpc.roll(state, kept).states[1]
    assert chooser.checker.is_safe(chooser.mpc.roll(state, chooser.kept), tight)
    assert not chooser.choose(Situation(state, tight, path, segment, False), False).emergency
