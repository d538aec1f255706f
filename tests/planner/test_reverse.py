"""Drives of a car with a reverse gear, out of places that forward alone it cannot leave."""

import functools
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rooms import CAR, Room, wrapped
from short_drive import LIDAR

from foresee.mapping.body import Scene, first_contact
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.control import Control
from foresee.mapping.grid import FREE, OCCUPIED, OccupancyGrid
from planner.motion.dynamics import rollout
from planner.motion.plan import Plan, mirrored
from planner.navigator import Navigator
from planner.navigator_config import NavigatorConfig
from sim import DubinsCar, Task
from sim.episode import EpisodeConfig, Outcome, run_episode

FASTEST_BACK = 0.5
"""Top speed in reverse [m/s]."""
DT = 0.1


def pocket(width, depth=4.0):
    """A dead end closed at the right, that opens to the left into a hall."""
    room = Room(12.0, 8.0, OCCUPIED).fill((0.0, 12.0 - depth), (0.0, 8.0), FREE)
    return room.fill((11.9 - depth, 12.0), (4.0 - 0.5 * width, 4.0 + 0.5 * width), FREE)


def lure(width):
    """A dead end on the straight way to the goal, which a passage at the top leads to."""
    room = Room(14.0, 8.0, OCCUPIED).fill((0.0, 5.0), (0.0, 8.0), FREE)
    room.fill((4.9, 9.0), (2.0 - 0.5 * width, 2.0 + 0.5 * width), FREE)
    return room.fill((4.9, 14.0), (6.0, 8.0), FREE).fill((10.0, 14.0), (0.0, 8.0), FREE)


PLACES = {
    "askew in a pocket": (pocket(1.6), (11.0, 3.8, 0.4), (4.0, 1.5)),
    "lured into a pocket": (lure(1.6), (1.5, 2.0, 0.0), (12.0, 2.0)),
    "lured into a narrow pocket": (lure(1.0), (1.5, 2.0, 0.0), (12.0, 2.0)),
}
"""Room, start, and goal."""
IN_LINE = {
    "near the end of a pocket": (pocket(1.6), (11.2, 4.0, 0.0), (2.0, 6.0)),
    "in the middle of a pocket": (pocket(1.6), (10.4, 4.0, 0.0), (2.0, 6.0)),
}
"""The same, of cars that look straight at the end: behind them nothing has been seen."""


def task_in(place) -> Task:
    room, start, goal = (PLACES | IN_LINE)[place]
    return Task(room.world, start, goal, np.array([goal]), math.dist(start[:2], goal), 0)


def motion(plan):
    """Poses (n, 3) of a plan's body, a centimetre apart or less, in the gear it is driven in."""
    poses = [plan.states[0, :3]]
    for state, (a, kappa) in zip(plan.states[:-1], plan.controls, strict=True):
        metres = max(abs(state[3]) * DT + 0.5 * a * DT**2, 0.0)
        for part in np.linspace(0.0, metres, math.ceil(metres / 0.01) + 1)[1:]:
            s = plan.gear * part
            turn = kappa * s
            chord = s * np.sinc(0.5 * turn / math.pi)
            ahead = state[2] + 0.5 * turn
            poses.append(
                [
                    state[0] + chord * math.cos(ahead),
                    state[1] + chord * math.sin(ahead),
                    state[2] + turn,
                ]
            )
    return np.array(poses)


def driver_in(task, reverse=FASTEST_BACK):
    """A navigator that knows nothing at the start."""
    config = NavigatorConfig(window=5.0, car=CarLimits(reverse=reverse))
    known = OccupancyGrid(task.world.grid.frame, config.window)
    return Navigator(config, None, np.array(task.start), task.goal, known, seed=task.seed)


@functools.cache
def driven(place, reverse=FASTEST_BACK, again=0, timeout=25.0):
    """The episode of a car that knows nothing at the start, and how often it relied on the unseen.

    Args:
        place: of `PLACES`.
        reverse: top speed in reverse [m/s]; 0: a car without that gear.
        again: which time the same is driven.
        timeout: as the episode's.
    """
    task = task_in(place)
    driver = driver_in(task, reverse)
    known, decide, unseen = driver.known, driver.step, []

    def step(state, scan):
        decision = decide(state, scan)
        if decision.plan.gear < 0:
            blocked, body = known.cells != FREE, CAR.body
            unseen.append(
                first_contact(
                    Scene(blocked, *known.frame.lattice, *body.halves), motion(decision.plan)
                )
            )
        return decision

    driver.step = step
    rng = np.random.default_rng(0)
    episode = run_episode(
        task,
        driver,
        DubinsCar(CarLimits(reverse=reverse)),
        LIDAR,
        EpisodeConfig(timeout=timeout),
        rng,
    )
    return episode, unseen


@pytest.mark.parametrize("place", PLACES)
def test_a_car_with_a_reverse_gear_gets_out_of_a_dead_end_to_its_goal(place):
    episode, _ = driven(place)
    assert episode.outcome is Outcome.REACHED
    assert episode.min_clearance > 0.0
    assert (episode.trace["gears"] == -1).any()
    assert (episode.trace["kept"] == -1).all()


def test_a_decision_that_changes_the_gear_can_be_withdrawn():
    task = task_in("askew in a pocket")
    driver, state = driver_in(task), np.array([*task.start, 0.0])
    car = DubinsCar(CarLimits(reverse=FASTEST_BACK))
    rng, changes = np.random.default_rng(0), 0
    while changes < 2:
        gear, legs = driver.guide.gear, list(driver.guide._legs)
        scan = LIDAR.scan(task.world, state, rng)
        control = driver.step(state, scan).control
        if driver.guide.gear != gear:
            changes += 1
            driver.withdraw()
            assert (driver.guide.gear, len(driver.guide._legs)) == (gear, len(legs))
            assert driver.chooser is driver._choosers[gear]
            # The next decision changes the gear again.
            again = driver.step(state, scan)
            assert again.control.gear == control.gear == -gear
            assert not again.faults
        state = car.step(state, control, DT)


@pytest.mark.parametrize("place", IN_LINE)
def test_a_car_that_has_seen_nothing_behind_it_gets_out_all_the_same(place):
    episode, unseen = driven(place)
    assert episode.outcome is Outcome.REACHED
    assert set(unseen) == {-1}


@pytest.mark.parametrize("place", PLACES)
def test_in_reverse_it_is_never_faster_than_that_gear_allows(place):
    states = driven(place)[0].trace["states"]
    assert states[:, 3].min() >= -FASTEST_BACK - 1e-9
    assert states[:, 3].min() < -0.2


@pytest.mark.parametrize("place", PLACES)
def test_it_backs_up_without_a_stop_on_the_way(place):
    trace = driven(place)[0].trace
    gears, speeds = trace["gears"].astype(int), trace["states"][:, 3]
    changes = [0, *(np.flatnonzero(np.diff(gears)) + 1), len(gears)]
    for begin, end in itertools.pairwise(changes):
        if gears[begin] < 0:
            assert (speeds[begin + 1 : end] < -1e-6).all()


@pytest.mark.parametrize("place", PLACES)
def test_the_gear_changes_at_standstill_only(place):
    trace = driven(place)[0].trace
    gears, speeds = trace["gears"].astype(int), trace["states"][:, 3]
    assert set(gears) == {1, -1}
    changes = np.flatnonzero(np.diff(gears)) + 1
    assert np.abs(speeds[changes]).max() < 1e-6
    # In the gear that is recorded, and in no other, it moved.
    assert (gears * speeds[:-1] >= -1e-6).all()
    assert (gears * speeds[1:] >= -1e-6).all()


@pytest.mark.parametrize("place", PLACES)
def test_in_reverse_every_plan_keeps_to_what_has_been_seen_free(place):
    _, unseen = driven(place)
    assert len(unseen) > 5
    assert set(unseen) == {-1}


@pytest.mark.parametrize("place", PLACES)
def test_in_reverse_the_plan_is_its_own_last_resort(place):
    trace = driven(place)[0].trace
    backwards = trace["gears"] < 0
    plans, stops = trace["plans"][backwards], trace["last_resorts"][backwards]
    assert np.abs(plans[:, :, 1]).max() > 0.1
    # A car that rests brakes on in its last resort.
    assert stops[:, :3, 1] == pytest.approx(plans[:, :3, 1], abs=1e-3)


def test_without_a_scan_the_car_goes_on_in_reverse_along_its_last_resort():
    task = task_in("askew in a pocket")
    driver, car = driver_in(task), DubinsCar(CarLimits(reverse=FASTEST_BACK))
    rng, state = np.random.default_rng(0), np.array([*task.start, 0.0])
    for _ in range(200):
        decision = driver.step(state, LIDAR.scan(task.world, state, rng))
        if decision.control.gear < 0 and abs(decision.last_resort[1, 1]) > 0.1:
            break
        state = car.step(state, decision.control, DT)
    skipped = driver.skip()
    assert skipped.control == Control(*decision.last_resort[1].tolist(), -1)
    # Its plan is that manoeuvre, from where the plan before has led.
    assert skipped.plan.gear == -1
    assert skipped.plan.states[0] == pytest.approx(decision.plan.states[1])
    assert skipped.plan.controls[0] == pytest.approx(decision.last_resort[1])
    assert skipped.plan.states[-1, 3] == pytest.approx(0.0)


@pytest.mark.parametrize("place", PLACES)
def test_every_plan_ends_at_rest_within_the_limits_of_its_gear(place):
    trace = driven(place)[0].trace
    start, a = trace["states"][:-1, 3], trace["plans"][:, :, 0].astype(float)
    ends = np.abs(start) + DT * a.sum(axis=1)
    # Controls are recorded in half precision.
    assert ends[~trace["emergency"]] == pytest.approx(0.0, abs=0.03)


def test_a_car_without_a_reverse_gear_never_gets_a_negative_gear():
    episode, unseen = driven("askew in a pocket", 0.0, timeout=6.0)
    assert episode.outcome is not Outcome.COLLIDED
    assert unseen == []
    assert (episode.trace["gears"] == 1).all()
    assert (episode.trace["states"][:, 3] >= 0.0).all()


def test_the_same_seed_gives_the_same_drive():
    first, second = (driven("askew in a pocket", again=again)[0].trace for again in (0, 1))
    assert set(first) == set(second)
    for name in first:
        if name != "times":
            assert np.array_equal(first[name], second[name]), name


@st.composite
def plans(draw):
    """Plans of a car forward, within its limits."""
    state = np.array(
        [
            draw(st.floats(-5, 5)),
            draw(st.floats(-5, 5)),
            draw(st.floats(-3, 3)),
            draw(st.floats(0, 3)),
        ]
    )
    controls = draw(
        st.lists(st.tuples(st.floats(-1.5, 1.5), st.floats(-1.2, 1.2)), min_size=1, max_size=12)
    )
    return Plan(*rollout(state, np.array(controls), DT, CAR.driving))


@given(plans())
def test_mirrored_twice_a_plan_is_the_same_motion(plan):
    twice = plan.mirrored().mirrored()
    assert twice.gear == plan.gear == 1
    assert plan.mirrored().gear == -1
    assert np.array_equal(twice.controls, plan.controls)
    assert twice.states[:, [0, 1, 3]] == pytest.approx(plan.states[:, [0, 1, 3]])
    assert wrapped(twice.states[:, 2] - plan.states[:, 2]) == pytest.approx(0.0, abs=1e-9)
    assert mirrored(mirrored(plan.states[0]))[3] == plan.states[0, 3]


@given(plans())
def test_a_mirrored_plan_is_the_same_places_backwards(plan):
    mirror = plan.mirrored()
    assert mirror.states[:, :2] == pytest.approx(plan.states[:, :2])
    assert mirror.states[:, 3] == pytest.approx(-plan.states[:, 3])
    # The car of the simulation, told to drive it, is where the plan says.
    car = DubinsCar(CarLimits(reverse=CAR.v_max))
    state = mirror.states[0]
    for control, expected in zip(mirror.controls, mirror.states[1:], strict=True):
        state = car.step(state, Control(*control, gear=-1), DT)
        assert state[[0, 1, 3]] == pytest.approx(expected[[0, 1, 3]], abs=1e-6)
        assert float(wrapped(state[2] - expected[2])) == pytest.approx(0.0, abs=1e-6)


@given(plans())
def test_the_poses_of_a_mirrored_plan_cover_the_same_places(plan):
    forward, back = plan.poses(DT, 0.02), plan.mirrored().poses(DT, 0.02)
    assert back[:, :2] == pytest.approx(forward[:, :2])
    assert wrapped(back[:, 2] - forward[:, 2] - math.pi) == pytest.approx(0.0, abs=1e-9)
