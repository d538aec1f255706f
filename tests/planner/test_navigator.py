"""The chain from scan to control."""

import dataclasses
import math

import numpy as np
import pytest
from short_drive import LIDAR, drive, navigator, straight

from foresee.mapping.body import Body
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.conventions import REST
from foresee.mapping.error_bounds import ErrorBounds
from foresee.mapping.grid import FREE, HIGHEST, LOWEST, OCCUPIED, Grid, GridFrame, OccupancyGrid
from foresee.mapping.scan import Scan
from foresee.prediction import Prediction
from planner.fault import Fault
from planner.motion.path import Path as Way
from planner.mpc.mpc import Solution, Status
from planner.navigator import Navigator
from planner.navigator_config import NavigatorConfig
from planner.risk.adaptive_level import DOUBT_KEPT
from planner.risk.risk_map import RiskMap
from planner.safety.collision import swept_cells
from planner.safety.situation import Situation
from sim import DubinsCar, generate, sample_task
from sim.episode import EpisodeConfig, Outcome
from sim.errors import Actuators

BLIND = Scan(np.full(3, np.nan), -0.1, 0.1, 10.0)
"""A scan without a measurement."""


def test_a_state_that_is_not_finite_is_refused():
    task = straight()
    driver = navigator(task)
    with pytest.raises(ValueError, match="finite"):
        driver.step(np.array([0.0, math.nan, 0.0, 0.0]), LIDAR.scan(task.world, task.start))


def test_a_pose_that_lies_in_another_frame_is_refused():
    task = straight()
    driver = navigator(task)
    with pytest.raises(ValueError, match="is the pose in the frame of the map"):
        driver.step(np.array([1e6, 1e6, 0.0, 0.0]), LIDAR.scan(task.world, task.start))


def free_all_round(cell):
    """A map without walls, in cells of any size."""
    count = round(24.0 / cell)
    known = OccupancyGrid(GridFrame(cell, (-12.0, -12.0), (count, count)), 5.0)
    known.log_odds[:] = LOWEST
    return known


def test_a_body_longer_than_the_usual_risk_map_drives():
    car = CarLimits(v_max=2.0, body=Body(8.0, 1.0), turning_radius=6.0)
    driver = Navigator(
        NavigatorConfig(car=car), None, np.zeros(3), (9.0, 0.0), free_all_round(0.05)
    )
    state, sim = np.zeros(4), DubinsCar(car)
    for _ in range(10):
        decision = driver.step(state, BLIND)
        assert not decision.emergency
        state = sim.step(state, decision.control, 0.1)
    assert state[3] > 0.5


@pytest.mark.parametrize("cell", [0.05, 0.0125, 0.014])
def test_predictions_are_remembered_while_the_map_grows_in_cells_of_any_size(cell):
    class Half:
        side = 6.0

        def predict(self, view):
            half = np.full(view.known.frame.shape, 0.5, np.float32)
            return Prediction(view.known.frame, half, half, half)

    known = OccupancyGrid(GridFrame(cell, (-4.0, -4.0), (round(8.0 / cell),) * 2), 5.0)
    config = NavigatorConfig(steer=True)
    driver = Navigator(config, Half(), np.array([0.0, 0.0, math.pi]), (-3.0, 0.0), known)
    state = np.array([0.0, 0.0, math.pi, 0.0])
    for goal in ((-3.0, 0.0), (-9.0, -7.0)):
        driver.head_for(goal)
        for _ in range(3):
            assert Fault.PATH_FAILED not in driver.step(state, BLIND).faults


def test_without_a_safe_plan_what_was_kept_is_sent_as_it_was_tested():
    # A car with a lag still moves where its plan stands: braking as the newest estimate asks for
    # would be too weak.
    bounds = ErrorBounds(delay=0.1, jitter=0.02, lag=0.25)
    known, car = free_all_round(0.05), CarLimits()
    config = NavigatorConfig(car=car, bounds=bounds)
    driver = Navigator(config, None, np.zeros(3), (10.0, 0.0), known)
    state, sim = np.zeros(4), DubinsCar(car)
    actuators = Actuators(bounds, np.random.default_rng(0))
    opened = 0
    for tick in range(55):
        if tick == 15:
            known.log_odds[:] = HIGHEST
        kept = driver.chooser.kept[0].copy()
        decision = driver.step(state, BLIND)
        if Fault.OPEN_LOOP in decision.faults:
            opened += 1
            if np.abs(decision.plan.states[:2, 3]).max() >= REST:
                control = decision.control
                assert (control.acceleration, control.curvature) == tuple(kept)
        for control, span in actuators.during(decision.control, 0.1, abs(state[3]) > REST):
            state = sim.step(state, control, span)
    assert opened > 10
    assert state[3] == 0.0


@pytest.mark.parametrize(
    "changes",
    [
        {"reliance": -0.1},
        {"reliance": 1.1},
        {"reliance": math.nan},
        {"level": -0.1},
        {"level": 1.0},
        {"level": math.nan},
        {"level": 0.2, "reliance": 0.1},
        {"level": 0.2, "reliance": 1.0},
        {"expansion": 0.9},
        {"window": math.nan},
        {"window": 0.0},
        {"deadline": math.nan},
        {"start_margin": -1.0},
    ],
)
def test_settings_that_make_no_sense_are_refused(changes):
    with pytest.raises(ValueError, match="must"):
        NavigatorConfig(**changes)


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
@pytest.mark.parametrize("name", ["v_max", "braking", "turning_radius"])
def test_a_car_without_sensible_limits_is_refused(name, value):
    with pytest.raises(ValueError, match=name):
        CarLimits(**{name: value})


class Certain:
    def predict(self, view):
        frame = view.known.frame
        ones, zeros = np.ones(frame.shape, np.float32), np.zeros(frame.shape, np.float32)
        return Prediction(frame, ones, zeros, ones)


@pytest.mark.parametrize("level", [0.0, 1e-9])
def test_only_above_level_zero_a_prediction_makes_unobserved_cells_certain(level):
    task = straight()
    driver = navigator(task, Certain(), reliance=0.05, level=level, adapt=False)
    state = np.array([*task.start, 0.0])
    for _ in range(10):
        decision = driver.step(state, LIDAR.scan(task.world, state))
        state = DubinsCar().step(state, decision.control, 0.1)
        risk = decision.risk_map
        assert risk.safe[risk.known.unknown].any()
        assert (risk.certain & risk.known.unknown).any() == (level > 0.0)


@pytest.mark.parametrize(("doubt", "certain"), [(1.0, True), (1.9, True), (2.1, False)])
def test_the_level_of_the_last_resort_is_divided_by_the_doubt(doubt, certain):
    class Doubting:
        def predict(self, view):
            frame = view.known.frame
            free, sure = np.full(frame.shape, 0.9, np.float32), np.ones(frame.shape, np.float32)
            return Prediction(frame, free, 0 * free, sure, doubt=doubt)

    task = straight()
    driver = navigator(task, Doubting(), reliance=0.2, level=0.2, adapt=False)
    state = np.array([*task.start, 0.0])
    risk = driver.step(state, LIDAR.scan(task.world, state)).risk_map
    # What the plan may enter does not change.
    assert (risk.safe & risk.known.unknown).any()
    assert (risk.certain & risk.known.unknown).any() == certain


def test_a_doubt_is_forgotten_slowly():
    class Forgetful:
        doubt = 30.0

        def predict(self, view):
            frame = view.known.frame
            free, sure = np.full(frame.shape, 0.95, np.float32), np.ones(frame.shape, np.float32)
            return Prediction(frame, free, 0 * free, sure, doubt=self.doubt)

    task, predictor = straight(), Forgetful()
    driver = navigator(task, predictor, reliance=0.2, level=0.2, adapt=False)
    state = np.array([*task.start, 0.0])
    certain = []
    for _ in range(120):
        risk = driver.step(state, LIDAR.scan(task.world, state)).risk_map
        certain.append((risk.certain & risk.known.unknown).any())
        predictor.doubt = 1.0
    # A level of 0.05 is enough here: the doubt must have fallen to 4.
    assert certain == [tick >= math.log(4.0 / 30.0) / math.log(DOUBT_KEPT) for tick in range(120)]


def test_a_car_that_starts_enclosed_by_the_unknown_sets_off():
    task = straight()
    driver = navigator(task)
    state = np.array([*task.start, 0.0])
    seen = driver.known.crop(driver.known.frame)
    assert seen.free.sum() * driver.known.frame.resolution**2 < 2.5
    for _ in range(15):
        decision = driver.step(state, LIDAR.scan(task.world, state))
        state = DubinsCar().step(state, decision.control, 0.1)
    assert state[3] > 0.5


def test_the_first_path_is_planned_and_driven_in_the_first_tick():
    for task in (straight(), sample_task(generate("office", 1), 1)):
        driver = navigator(task)
        state = np.array([*task.start, 0.0])
        decision = driver.step(state, LIDAR.scan(task.world, state))
        assert decision.path is not None
        assert decision.faults == ()
        assert DubinsCar().step(state, decision.control, 0.1)[3] > 0.05


@pytest.mark.parametrize("waits", [1, 3, 7])
@pytest.mark.parametrize("kappa", [0.0, 0.3])
def test_a_plan_that_waits_first_is_driven_at_once_over_the_same_cells(waits, kappa):
    task = straight()
    driver = navigator(task)
    state = np.array([*task.start, 0.0])
    controls = np.zeros((driver.chooser.mpc.stages, 2))
    controls[waits : waits + 5] = (1.0, kappa)
    controls[waits + 5 : waits + 10] = (-1.0, kappa)
    waiting = driver.chooser.mpc.roll(state, controls)
    driver.chooser.mpc.solve = lambda *_: Solution(waiting, 0.0, Status.CONVERGED)
    decision = driver.step(state, LIDAR.scan(task.world, state))
    plan, frame = decision.plan, decision.risk_map.frame
    assert plan.states[1, 3] > 0.05
    assert plan.states[: len(plan.states) - waits] == pytest.approx(waiting.states[waits:])
    assert plan.states[-1] == pytest.approx(waiting.states[-1])
    every = np.ones(frame.shape, dtype=bool)
    mine, others = (
        swept_cells(p, 0.1, driver.config.car.body, frame, every) for p in (plan, waiting)
    )
    assert np.array_equal(np.array(mine), np.array(others))


def test_a_car_never_waits_for_good_where_it_might_go_on():
    # Whatever the solver puts off, it puts off no more than once.
    task = straight()
    driver = navigator(task)
    solve = driver.chooser.mpc.solve

    def putting_off(state, *others):
        solution = solve(state, *others)
        controls = np.vstack([np.zeros((2, 2)), solution.plan.controls[:-2]])
        return dataclasses.replace(solution, plan=driver.chooser.mpc.roll(state, controls))

    driver.chooser.mpc.solve = putting_off
    state = np.array([*task.start, 0.0])
    for _ in range(30):
        decision = driver.step(state, LIDAR.scan(task.world, state))
        state = DubinsCar().step(state, decision.control, 0.1)
    assert state[0] > task.start[0] + 0.5


def test_a_car_that_sees_nothing_stays_where_it_may():
    task = straight()
    driver = navigator(task)
    blind = dataclasses.replace(LIDAR.scan(task.world, task.start), ranges=np.full(541, np.nan))
    start = driver.known.crop(driver.known.frame).free
    state = np.array([*task.start, 0.0])
    for _ in range(40):
        decision = driver.step(state, blind)
        assert (decision.risk_map.safe <= decision.risk_map.known.free).all()
        state = DubinsCar().step(state, decision.control, 0.1)
    assert state[3] < 0.05
    assert math.hypot(state[0] - task.start[0], state[1] - task.start[1]) < 0.55
    assert np.array_equal(driver.known.crop(driver.known.frame).free.sum(), start.sum())


@pytest.mark.parametrize("family", ["corridor", "narrow", "office", "trap"])
def test_at_zero_risk_the_car_never_collides_and_relies_on_nothing_unseen(family):
    task = sample_task(generate(family, 1), 1)
    episode = drive(task, navigator(task), EpisodeConfig(timeout=0.6))
    assert episode.outcome is not Outcome.COLLIDED
    assert episode.path_length > 1.0
    assert (episode.trace["kept"] == -1).all()
    assert not episode.trace["emergency"].any()
    assert episode.min_clearance > 0.0


def test_the_straight_is_driven_to_its_end():
    task = straight()
    episode = drive(task, navigator(task))
    assert episode.outcome is Outcome.REACHED
    assert episode.faults == {}
    assert episode.path_length == pytest.approx(task.path_length - 0.5, abs=0.3)


def test_a_car_swerves_where_it_would_stop_with_its_nose_in_a_corner():
    driver = navigator(straight())
    frame = GridFrame(0.05, (-6.0, -8.0), (200, 200))
    x, y = frame.centres()
    # What had looked like a way out is where two walls meet.
    room = (y[:, None] < 0.34 * x) & (x < -0.35 * y[:, None])
    cells = np.where(room, np.int8(FREE), np.int8(OCCUPIED))
    risk = RiskMap.from_prediction(Grid(frame, cells), None, 0.0)
    way = np.array([[-3.0, -3.1], [-2.3, -2.95], [0.6, 0.85]])
    state = np.array([-2.4, -2.98, 0.26, 3.08])
    choice = driver.chooser.choose(
        Situation(state, risk, Way.through(way, "ompl"), 0, False), False
    )
    assert not choice.emergency
    assert driver.chooser.checker.is_safe(choice.plan, risk)
    assert driver.chooser.goes_on(choice.plan, risk)


class Sure:
    """Believes that all there is is free, with one confidence."""

    def __init__(self, confidence=1.0):
        self.confidence = confidence

    def predict(self, view):
        known = view.known
        ones = np.ones(known.frame.shape, np.float32)
        return Prediction(known.frame, ones, 0 * ones, self.confidence * ones)


@pytest.mark.parametrize(("family", "seed"), [("narrow", 1), ("trap", 1), ("office", 2)])
def test_a_belief_that_breaks_is_survived_unless_there_was_no_doubt_in_it(family, seed):
    task = sample_task(generate(family, seed), seed)
    driver = navigator(task, Sure(0.95), reliance=0.1)
    decide = driver.step

    def step(state, scan):
        decision = decide(state, scan)
        # From where this tick leads some way to a stop lies in what has been seen free.
        after = driver.chooser.mpc.roll(state, decision.plan.controls).states[1]
        resort = driver.chooser.mpc.roll(after, driver.chooser.resort.controls)
        risk = decision.risk_map
        assert resort.states[-1, 3] < 1e-6
        assert driver.chooser.checker.contact(resort, ~risk.known.free, risk.frame) is None
        return decision

    driver.step = step
    episode = drive(task, driver, EpisodeConfig(timeout=0.6))
    assert episode.outcome is not Outcome.COLLIDED
    assert "no_last_resort" not in episode.faults
    assert (episode.trace["kept"] == 0).any()


@pytest.mark.parametrize(("side", "asked"), [(None, 10.0), (0.0, 10.0), (16.0, 16.0)])
def test_a_predictor_is_asked_for_the_square_that_it_states(side, asked):
    task, predictor, frames = straight(), Sure(), []

    def predict(view):
        frames.append(view.known.frame)
        return Sure().predict(view)

    predictor.predict = predict
    if side is not None:
        predictor.side = side
    state = np.array([*task.start, 0.0])
    decision = navigator(task, predictor, reliance=0.1).step(state, LIDAR.scan(task.world, state))
    assert decision.prediction is not None
    assert [frame.resolution * frame.shape[0] for frame in frames] == [pytest.approx(asked)]


def test_a_sure_prediction_of_free_space_makes_the_car_faster():
    task = straight()
    config = EpisodeConfig(timeout=0.9)
    plain = drive(task, navigator(task, None), config)
    sure = drive(task, navigator(task, Sure(), reliance=0.1), config)
    distrusted = drive(task, navigator(task, Sure(), reliance=0.0), config)
    assert sure.max_speed > plain.max_speed + 0.3
    assert (sure.trace["kept"] >= 0).any()
    assert np.array_equal(distrusted.trace["states"], plain.trace["states"])


def test_a_prediction_below_what_plans_rely_on_changes_nothing():
    class Untrusted:
        def predict(self, view):
            frame = view.known.frame
            free, sure = np.full(frame.shape, 0.6, np.float32), np.ones(frame.shape, np.float32)
            return Prediction(frame, free, 0.5 * free, sure)

    task, config = straight(), EpisodeConfig(timeout=0.9)
    plain = drive(task, navigator(task, None), config)
    untrusted = drive(task, navigator(task, Untrusted(), reliance=0.3), config)
    assert np.array_equal(untrusted.trace["states"], plain.trace["states"])


@pytest.mark.parametrize("speed", [-0.02, -0.5])
@pytest.mark.parametrize("bounds", [ErrorBounds(), ErrorBounds(delay=0.1, position=0.02)])
def test_a_car_that_rolls_against_its_gear_brakes_and_then_drives_on(speed, bounds):
    car = CarLimits(reverse=1.0)
    frame = GridFrame(0.05, (-10.0, -10.0), (400, 400))
    known = OccupancyGrid(frame, 5.0)
    known.log_odds[:] = LOWEST
    row, column = frame.cell(-2.0, 0.0)
    known.log_odds[row - 40 : row + 40, column - 3 : column] = HIGHEST
    nav = Navigator(NavigatorConfig(car=car, bounds=bounds), None, np.zeros(3), (8.0, 0.0), known)
    nothing = Scan(np.full(360, np.nan), -math.pi, math.pi / 180, 12.0)
    state, states = np.array([0.0, 0.0, 0.0, speed]), []
    for _ in range(20):
        decision = nav.step(state, nothing)
        if state[3] < -REST:
            assert Fault.ROLLS_BACK in decision.faults
            assert decision.control.acceleration == -car.braking
        state = DubinsCar(car).step(state, decision.control, 0.1)
        states.append(state)
    assert min(state[0] for state in states) > -0.2
    assert states[-1][3] > 1.0


def test_one_place_where_the_car_is_stuck_is_kept_once():
    nav = navigator(straight())
    state = np.array([0.5, 0.0, 0.0, 0.0])
    for _ in range(3):
        risk = nav._risk_map(state, None)
        nav.guide.unstick(0, state, nav.known, risk, None, 0.0)
    assert len(nav.guide._stuck) == 1


@pytest.mark.parametrize("given", ["start", "goal", "waypoints"])
def test_a_drive_that_is_not_finite_is_refused(given):
    places = {"start": np.zeros(3), "goal": (1.0, 0.0), "waypoints": np.ones((1, 2))}
    places[given] = np.full_like(np.asarray(places[given], dtype=float), np.nan)
    known = OccupancyGrid(GridFrame(0.05, (-1.0, -1.0), (40, 40)), 5.0)
    with pytest.raises(ValueError, match=f"{given} is .*, it must be finite"):
        Navigator(NavigatorConfig(), None, known=known, **places)


def test_a_route_that_does_not_lead_to_the_goal_is_refused():
    known = OccupancyGrid(GridFrame(0.05, (-1.0, -1.0), (40, 40)), 5.0)
    route = np.array([[2.0, 0.0], [4.0, 3.0]])
    with pytest.raises(ValueError, match=r"the last waypoint is 3.00 m from the goal"):
        Navigator(NavigatorConfig(), None, np.zeros(3), (4.0, 0.0), known, route)


def test_the_same_drive_twice_is_the_same_drive():
    task = sample_task(generate("narrow", 2), 2)
    config = EpisodeConfig(timeout=0.2)
    first, second = (drive(task, navigator(task), config).trace for _ in range(2))
    for name in first:
        if name != "times":
            assert np.array_equal(first[name], second[name]), name
