"""The manoeuvre that stops the car within certain cells, in every tick."""

from dataclasses import replace

import numpy as np
import pytest

from foresee.mapping.body import Body
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from foresee.prediction import Prediction
from planner.motion.path import Path
from planner.motion.plan import Plan
from planner.mpc.mpc import MPC
from planner.risk.risk_map import RiskMap
from planner.safety import last_resort
from planner.safety.collision import CollisionChecker
from planner.safety.last_resort import LastResort
from planner.safety.tube import EXACT

CAR, DT = CarLimits(), 0.1
CHECKER = CollisionChecker(CAR, DT)
FRAME = GridFrame(0.05, (-2.0, -3.0), (120, 160))
WINDOW = 5.0
STRAIGHT = Path.through(np.array([[0.0, 0.0], [8.0, 0.0]]), "route")


@pytest.fixture(scope="module")
def mpc() -> MPC:
    return MPC(CAR)


def secure(resort, state, plan, risk, path=STRAIGHT, cautious=lambda: None):
    course = resort.checker.course_on(path, 0, risk)
    return resort.secure(state, plan, risk, course, cautious)


def risk_of(cells) -> RiskMap:
    """The risk map of a prediction that all unobserved cells are free: safe, but not certain."""
    ones = np.ones(FRAME.shape, np.float32)
    return RiskMap.from_prediction(Grid(FRAME, cells), Prediction(FRAME, ones, 0 * ones, ones), 0.1)


def onward(mpc, speed):
    """A car at the origin, and a plan that accelerates before it stops."""
    controls = np.zeros((mpc.stages, 2))
    controls[:, 0] = -CAR.braking
    controls[:4, 0] = 1.0
    state = np.array([0.0, 0.0, 0.0, speed])
    return state, mpc.roll(state, controls)


@pytest.mark.parametrize("seed", range(12))
def test_what_is_kept_meets_no_single_cell_that_is_uncertain(mpc, seed):
    cells = np.full(FRAME.shape, FREE, np.int8)
    cells[np.random.default_rng(seed).random(FRAME.shape) < 0.004] = UNKNOWN
    cells[50:70, :50] = FREE
    risk = risk_of(cells)
    state, plan = onward(mpc, 2.0)
    resort = LastResort(mpc, CHECKER, WINDOW)
    driven, survivable = secure(resort, state, plan, risk)
    assert CHECKER.is_safe(driven, risk)
    if survivable:
        kept = mpc.roll(driven.states[1], resort.controls)
        assert kept.states[-1, 3] == pytest.approx(0.0, abs=1e-9)
        assert CHECKER.contact(kept, ~risk.certain, FRAME) is None


@pytest.mark.parametrize("seed", range(8))
def test_a_small_car_does_not_step_over_uncertain_cells(seed):
    small = CarLimits(body=Body(0.04, 0.04))
    mpc, checker = MPC(small), CollisionChecker(small, DT)
    cells = np.full(FRAME.shape, FREE, np.int8)
    cells[np.random.default_rng(seed).random(FRAME.shape) < 0.03] = UNKNOWN
    cells[58:62, :45] = FREE
    risk = risk_of(cells)
    state, plan = onward(mpc, 2.5)
    resort = LastResort(mpc, checker, WINDOW)
    driven, survivable = secure(resort, state, plan, risk)
    if survivable:
        kept = mpc.roll(driven.states[1], resort.controls)
        assert checker.contact(kept, ~risk.certain, FRAME) is None


@pytest.mark.parametrize(("room", "survivable"), [(0.3, False), (3.0, True)])
def test_a_car_is_told_whether_a_last_resort_remains(mpc, room, survivable):
    cells = np.full(FRAME.shape, FREE, np.int8)
    cells[:, FRAME.centres()[0] > CAR.body.half_length + room] = UNKNOWN
    risk = risk_of(cells)
    state, plan = onward(mpc, 3.0)
    assert CHECKER.contact(plan, ~risk.certain, FRAME) is not None
    driven, remains = secure(LastResort(mpc, CHECKER, WINDOW), state, plan, risk)
    assert remains is survivable
    if not remains:
        assert driven.controls[0, 0] == pytest.approx(-CAR.braking)


def test_the_rest_of_the_last_manoeuvre_is_tried_again(mpc):
    _, plan = onward(mpc, 2.0)
    resort = LastResort(mpc, CHECKER, WINDOW)
    resort.controls = np.column_stack(
        [np.full(mpc.stages, -1.2), np.linspace(-0.7, 0.4, mpc.stages)]
    )
    assert any(np.array_equal(each, resort.controls) for each in resort.manoeuvres(plan))


def test_where_only_hard_braking_leaves_a_manoeuvre_the_car_brakes_hard(mpc):
    state, plan = onward(mpc, 3.0)
    x, y = FRAME.centres()
    cells = np.full(FRAME.shape, UNKNOWN, np.int8)
    # It stops within 3 m; half of the braking in the first step costs 15 cm.
    cells[np.ix_(abs(y) < CAR.body.half_width + 0.1, x < CAR.body.half_length + 3.07)] = FREE
    driven, remains = secure(LastResort(mpc, CHECKER, WINDOW), state, plan, risk_of(cells))
    assert remains
    assert driven.controls[0, 0] < -0.8 * CAR.braking


def side_corridor():
    """A corridor along x that is observed, and one that turns off to the right at x = 5 m, in which
    nothing was: the cells, and the path that turns into it."""
    x, y = WIDE.centres()
    cells = np.full(WIDE.shape, OCCUPIED, np.int8)
    cells[np.ix_(abs(y) < 1.0, x < 7.0)] = FREE
    cells[np.ix_((y < -1.0) & (y > -6.0), abs(x - 5.0) < 1.0)] = UNKNOWN
    return cells, Path.through(
        np.array([[0.0, 0.0], [4.0, 0.0], [5.0, -1.0], [5.0, -5.0]]), "route"
    )


WIDE = GridFrame(0.05, (-2.0, -7.0), (200, 220))


def around_the_corner(mpc):
    """A car in `side_corridor`, a plan around its corner, risk map, and rest of the path."""
    cells, path = side_corridor()
    ones = np.ones(WIDE.shape, np.float32)
    walls = (cells == OCCUPIED).astype(np.float32)
    belief = Prediction(WIDE, ones - walls, walls, ones)
    risk = RiskMap.from_prediction(Grid(WIDE, cells), belief, 0.1)
    state, path = np.array([2.0, 0.0, 0.0, 2.4]), Path(path.points[20:], "route")
    plan = mpc.solve(state, path, risk, mpc.pursue(state, path, 0), 0, 0.0).plan
    assert CHECKER.is_safe(plan, risk)
    return state, plan, risk, path


def test_a_cautious_plan_is_driven_where_the_plan_could_not_be_followed_on(mpc, monkeypatch):
    state, plan, risk, path = around_the_corner(mpc)
    assert CHECKER.contact(plan, ~risk.certain, risk.frame) is not None
    stop = mpc.roll(state, np.tile([-CAR.braking, 0.0], (mpc.stages, 1)))
    calls = []

    def cautious():
        calls.append(1)
        return stop

    resort = LastResort(mpc, CHECKER, WINDOW)
    driven, survivable = secure(resort, state, plan, risk, path, cautious)
    assert survivable
    # The plan can be followed on, since the corner will be seen in time.
    assert driven is plan
    monkeypatch.setattr(last_resort, "reveal", lambda *args: None)
    resort = LastResort(mpc, CHECKER, WINDOW)
    blind, survivable = secure(resort, state, plan, risk, path, cautious)
    assert survivable
    assert calls
    assert blind is stop
    assert resort.controls[:-1] == pytest.approx(stop.controls[1:])


def test_a_cautious_plan_that_is_slower_than_what_the_plan_allows_is_not_driven(mpc):
    state, plan, risk, path = around_the_corner(mpc)
    controls = np.tile([-CAR.braking, 0.0], (mpc.stages, 1))
    calls = []
    resort = LastResort(mpc, CHECKER, WINDOW)
    driven, _ = secure(
        resort, state, plan, risk, path, lambda: calls.append(1) or mpc.roll(state, controls)
    )
    assert driven.controls[0, 0] > -CAR.braking


def test_the_last_manoeuvre_is_followed_with_its_own_first_step(mpc):
    x, y = FRAME.centres()
    cells = np.full(FRAME.shape, UNKNOWN, np.int8)
    # A winding way is all that was observed.
    winding = np.full((mpc.stages, 2), -CAR.braking)
    winding[:, 1] = 0.6 * np.cos(np.arange(mpc.stages) / 3.0)
    bend = mpc.roll(np.array([0.0, 0.0, 0.0, 2.2]), winding)
    seen = np.zeros(FRAME.shape, dtype=bool)
    for px, py, *_ in bend.states:
        seen |= np.hypot(x - px, y[:, None] - py) < 0.36
    cells[seen] = FREE
    risk = risk_of(cells)
    # The plan turns the other way, and no manoeuvre remains after its first step.
    state, plan = onward(mpc, 2.2)
    plan = mpc.roll(state, np.column_stack([plan.controls[:, 0], np.full(mpc.stages, -0.6)]))
    resort = LastResort(mpc, CHECKER, WINDOW)
    resort.controls = bend.controls
    resort.manoeuvres = lambda plan: resort.controls[None].copy()
    driven, survivable = secure(resort, state, plan, risk)
    assert survivable
    assert driven.controls == pytest.approx(bend.controls)
    assert resort.controls[:-1] == pytest.approx(bend.controls[1:])


def some_plan(mpc, state, rng):
    """A plan of random controls that ends at rest."""
    controls = np.full((mpc.stages, 2), -CAR.braking)
    controls[: rng.integers(1, 6), 0] = rng.uniform(0.5, 1.5)
    controls[:, 1] = np.repeat(rng.uniform(-1.25, 1.25, 4), 8)[: mpc.stages]
    return mpc.roll(state, controls)


@pytest.mark.parametrize("seed", range(6))
def test_a_last_resort_always_remains_whatever_is_planned(mpc, seed):
    """At level 0: whatever plans, predictions and foresight say, among any obstacles."""
    rng = np.random.default_rng(seed)
    (x, y), resort = FRAME.centres(), LastResort(mpc, CHECKER, WINDOW)
    occupied = rng.random(FRAME.shape) < 0.002
    state = np.array([2.0, 0.0, rng.uniform(-np.pi, np.pi), 0.0])
    occupied[np.hypot(x - state[0], y[:, None] - state[1]) < 0.6] = False
    cells, path = np.full(FRAME.shape, UNKNOWN, np.int8), STRAIGHT
    fastest, changed = 0.0, 0
    for tick in range(40):
        # What is near is observed, but not all of it.
        near = np.hypot(x - state[0], y[:, None] - state[1]) < (0.6 if tick == 0 else 1.5)
        seen = near & ((rng.random(FRAME.shape) < 0.9) | (tick == 0))
        cells[seen] = np.where(occupied, OCCUPIED, FREE)[seen]
        # All the rest is predicted free.
        risk = risk_of(cells)
        certain = risk.certain.copy()
        plans = [some_plan(mpc, state, rng) for _ in range(20)]
        careful = next((plan for plan in plans if CHECKER.is_safe(plan, risk.cautious)), None)
        driven, remains = secure(
            resort, state, plans[0], risk, path, lambda careful=careful: careful
        )
        assert remains
        assert np.array_equal(risk.certain, certain)
        assert driven.states[0] == pytest.approx(state, abs=0.0)
        first = CHECKER.contact(Plan(driven.states[:2], driven.controls[:1]), occupied, FRAME)
        assert first is None
        kept = mpc.roll(driven.states[1], resort.controls)
        assert CHECKER.is_safe(kept, risk.cautious)
        state = driven.states[1]
        fastest, changed = max(fastest, state[3]), changed + (driven is not plans[0])
    assert fastest > 0.5
    assert changed > 3


def unlimited(mpc):
    """A car at 2 m/s that may stop anywhere near, and a plan into what was not observed."""
    x, _ = FRAME.centres()
    cells = np.full(FRAME.shape, FREE, np.int8)
    cells[:, x > CAR.body.half_length + 2.0] = UNKNOWN
    state, plan = onward(mpc, 2.0)
    risk = risk_of(cells)
    assert CHECKER.contact(plan, ~risk.certain, FRAME) is not None
    return state, plan, risk


T, F = True, False


@pytest.mark.parametrize(
    ("anywhere", "on_course", "follows", "best"),
    [
        (2, 1, (T, T), 1),
        (2, 1, (T, F), 2),
        (2, 1, (F, T), 1),
        (2, 1, (F, F), None),
        (1, 2, (T, T), 1),
        (2, None, (F, T), None),
        (None, 2, (T, T), 2),
        (0, 0, (T, F), 0),
    ],
)
def test_the_fastest_first_step_that_meets_one_of_the_demands_is_taken(
    mpc, anywhere, on_course, follows, best
):
    resort, (state, plan, risk) = LastResort(mpc, CHECKER, WINDOW), unlimited(mpc)
    ends = {last_resort.ANYWHERE: anywhere, last_resort.ON_COURSE: on_course}
    resort._fastest = lambda state, firsts, manoeuvres, end, tests: ends[end]
    resort._can_follow = lambda *args: follows[args[-1].end == last_resort.ON_COURSE]
    assert (
        resort._foreseen(state, plan, np.zeros((3, 2)), risk, last_resort._Tests(0, 0, 0, EXACT))
        == best
    )


@pytest.mark.parametrize(("gain", "better"), [(0.5, False), (2.0, True), (-2.0, False)])
def test_a_cautious_plan_is_better_if_it_is_faster_and_ends_on_the_course(
    mpc, monkeypatch, gain, better
):
    _, plan, risk = unlimited(mpc)
    resort, course = LastResort(mpc, CHECKER, WINDOW), CHECKER.course_on(STRAIGHT, 0, risk)
    reached = plan.controls[0, 0] - gain * last_resort.SAME
    assert resort._is_better(plan, reached, course) == better
    monkeypatch.setattr(last_resort, "rejoins", lambda *args: False)
    assert not resort._is_better(plan, reached, course)


@pytest.mark.parametrize("leads", [True, False])
def test_the_last_manoeuvre_is_driven_where_no_plan_can_be_followed_if_it_leads_on(mpc, leads):
    state, plan, risk = unlimited(mpc)
    own = np.tile([-CAR.braking, 0.3], (mpc.stages, 1))
    if not leads:
        # It would end amid predicted walls.
        (x, y), end = FRAME.centres(), mpc.roll(state, own).states[-1]
        here = abs(np.hypot(x - end[0], y[:, None] - end[1]) - 0.8) < 0.2
        risk.barred[here] = True
    resort = LastResort(mpc, CHECKER, WINDOW)
    resort.controls, resort._foreseen = own, lambda *args: None
    driven, survivable = secure(resort, state, plan, risk)
    assert survivable
    assert (driven.controls[0, 1] == 0.3) == leads


@pytest.mark.parametrize(("speed", "ends"), [(2.0, (1, 0)), (0.1, (0,))])
def test_a_car_that_is_about_to_stop_need_not_be_able_to_go_on(mpc, speed, ends):
    state, plan, risk = unlimited(mpc)
    state[3] = speed
    plan, asked = mpc.roll(state, plan.controls), []
    risk = replace(risk, certain=risk.certain & False)
    resort = LastResort(mpc, CHECKER, WINDOW)
    resort._foreseen = lambda *args: pytest.fail("foreseen") if speed < 0.2 else None
    resort._fastest = lambda state, firsts, manoeuvres, end, tests: asked.append(end)
    secure(resort, state, plan, risk)
    assert tuple(asked) == ends


def test_a_plan_cannot_be_followed_where_no_manoeuvre_is_left_before_the_rest_is_seen(
    mpc, monkeypatch
):
    state, plan, risk, path = around_the_corner(mpc)
    monkeypatch.setattr(last_resort, "reveal", lambda *args: None)
    resort, course = LastResort(mpc, CHECKER, WINDOW), CHECKER.course_on(path, 0, risk)
    asked = []

    def first_free(state, manoeuvres, end, tests):
        asked.append(end)
        return -1 if len(asked) == 2 else 0

    resort._first_free = first_free
    demand = last_resort._Demand(last_resort.ANYWHERE, (1, 2, 3), last_resort.ON_COURSE)
    assert not resort._can_follow(state, plan, plan.controls[0], risk, course, demand)
    assert asked == [last_resort.ON_COURSE] * 2


def test_in_an_emergency_the_car_rather_leaves_what_is_safe_than_hits_a_wall(mpc):
    state, plan = onward(mpc, 2.5)
    x, y = FRAME.centres()
    cells = np.full(FRAME.shape, FREE, np.int8)
    # A wall that straight braking hits, and earlier, beside it, what was not observed.
    cells[np.ix_(y > 0.1, x > CAR.body.half_length + 1.0)] = OCCUPIED
    cells[np.ix_(y < -0.2, x > CAR.body.half_length + 0.4)] = UNKNOWN
    risk = RiskMap.from_prediction(Grid(FRAME, cells), None, 0.1)
    straight = mpc.roll(state, plan.controls)
    assert CHECKER.contact(straight, risk.known.occupied, FRAME) is not None
    resort = LastResort(mpc, CHECKER, WINDOW)
    stop = resort.brake(state, plan, risk)
    assert CHECKER.contact(stop, risk.known.occupied, FRAME) is None
    # Its rest is kept.
    rest = mpc.roll(stop.states[1], resort.controls)
    assert rest.states[:-1] == pytest.approx(stop.states[1:])


def test_a_stop_that_touches_something_at_rest_is_worse_than_one_that_touches_nothing(mpc):
    cells = np.full(FRAME.shape, FREE, np.int8)
    cells[:, FRAME.centres()[0] > 2.0] = OCCUPIED
    risk, controls = risk_of(cells), np.zeros((mpc.stages, 2))
    free, touching = (mpc.roll(np.array([x, 0.0, 0.0, 0.0]), controls) for x in (0.0, 1.76))
    resort = LastResort(mpc, CHECKER, WINDOW)
    assert resort._badness(free, risk) < resort._badness(touching, risk)
