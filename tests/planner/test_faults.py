"""Nothing bad that reaches the navigator reaches the wheels, whoever it comes from."""

import contextlib
import dataclasses
import functools
import math
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from short_drive import LIDAR, drive, navigator, straight

from foresee.mapping.scan import Scan
from foresee.prediction import BadPredictionError, Prediction, View
from planner.fault import Fault
from planner.motion.plan import Plan
from planner.mpc.mpc import Solution, Status
from planner.risk.ask_predictor import Asker, LateError
from sim import DubinsCar
from sim.episode import EpisodeConfig, Outcome


class Misbehaving:
    """A predictor that answers well twice, and then as it is told to."""

    def __init__(self, misbehave):
        self.misbehave, self.calls = misbehave, 0

    def predict(self, view):
        known = view.known
        self.calls += 1
        ones = np.ones(known.frame.shape, np.float32)
        zeros = np.zeros(known.frame.shape, np.float32)
        return self.misbehave(Prediction(known.frame, ones, zeros, zeros))


def raises(_):
    raise RuntimeError("a plug-in's own trouble")


def runs_out_of_memory(_):
    raise MemoryError


def exits(_):
    raise SystemExit(3)


def times_out_on_its_own(_):
    raise TimeoutError("a socket's, not the deadline's")


def of_the_wrong_shape(good):
    return dataclasses.replace(good, p_free=good.p_free[:-1])


def out_of_range(good):
    return dataclasses.replace(good, confidence=good.confidence + 2)


def negative(good):
    return dataclasses.replace(good, p_free=good.p_free - 2)


def sums_beyond_one(good):
    return dataclasses.replace(good, p_occupied=good.p_free)


def elsewhere(good):
    frame = dataclasses.replace(good.frame, origin=(0.01, 0.02))
    return dataclasses.replace(good, frame=frame)


def none(_):
    return None


def text(_):
    return "free everywhere"


def of_text(good):
    return dataclasses.replace(good, p_free=np.full(good.p_free.shape, "yes"))


def with_fields_of_none(good):
    return dataclasses.replace(good, p_free=None, confidence=None)


def ragged(good):
    return dataclasses.replace(good, p_free=[[1.0], [1.0, 2.0]])


FAULTS = {
    raises: "predictor_raised",
    runs_out_of_memory: "predictor_raised",
    exits: "predictor_raised",
    times_out_on_its_own: "predictor_raised",
    of_the_wrong_shape: "predictor_bad",
    out_of_range: "predictor_bad",
    negative: "predictor_bad",
    sums_beyond_one: "predictor_bad",
    elsewhere: "predictor_bad",
    none: "predictor_bad",
    text: "predictor_bad",
    of_text: "predictor_bad",
    with_fields_of_none: "predictor_bad",
    ragged: None,
}


@pytest.mark.parametrize("misbehave", FAULTS, ids=lambda f: f.__name__)
def test_a_car_whose_predictor_misbehaves_drives_on_in_known_space_and_counts_it(misbehave):
    task = straight()
    driver = navigator(task, Misbehaving(misbehave), reliance=0.3, steer=True)
    episode = drive(task, driver, EpisodeConfig(timeout=0.8))
    assert episode.outcome is not Outcome.COLLIDED
    assert episode.path_length > 1.0
    ticks = len(episode.trace["kept"])
    assert (episode.trace["relied_count"] == 0).all()
    counted = {k: n for k, n in episode.faults.items() if k.startswith("predictor_")}
    kind = FAULTS[misbehave]
    assert sum(counted.values()) == ticks
    assert kind is None or counted == {kind: ticks}


def with_nan(good):
    bad = np.full(good.p_free.shape, np.nan, np.float32)
    return dataclasses.replace(good, p_free=bad, confidence=np.ones_like(bad))


def with_nan_confidence(good):
    bad = np.full(good.p_free.shape, np.nan, np.float32)
    return dataclasses.replace(good, confidence=bad)


@pytest.mark.parametrize("misbehave", [with_nan, with_nan_confidence])
def test_a_prediction_of_nothing_but_nan_is_a_prediction_of_nothing(misbehave):
    task = straight()
    config = EpisodeConfig(timeout=0.8)
    blind = drive(task, navigator(task, Misbehaving(misbehave), reliance=0.3), config)
    plain = drive(task, navigator(task, None, reliance=0.3), config)
    assert np.array_equal(blind.trace["states"], plain.trace["states"])
    assert blind.faults["predictor_nan"] == len(blind.trace["kept"])
    assert "predictor_nan" not in plain.faults


def test_a_car_whose_predictor_hangs_drives_on_and_counts_it():
    task = straight()
    release = time.monotonic() + 4.0

    def hangs(good):
        time.sleep(max(0.0, release - time.monotonic()))
        return good

    class HangsLater(Misbehaving):
        def predict(self, view):
            if self.calls == 0:
                self.calls = 1
                return Misbehaving(lambda good: good).predict(view)
            return super().predict(view)

    driver = navigator(task, HangsLater(hangs), reliance=0.3, deadline=0.02)
    started = time.monotonic()
    state, speeds = np.array([*task.start, 0.0]), []
    for _ in range(25):
        decision = driver.step(state, LIDAR.scan(task.world, state))
        assert not DubinsCar().collides(task.world, state, decision.control, 0.1)
        state = DubinsCar().step(state, decision.control, 0.1)
        speeds.append(state[3])
        if time.monotonic() > release - 0.5:
            break
    assert max(speeds) > 0.5
    assert driver.faults["predictor_late"] >= len(speeds) - 2
    assert time.monotonic() - started < 10.0


SLEEP = 30.0
"""Longer than these tests take [s], so that nobody can have waited for it."""


class Sleeper:
    """An object whose destruction takes long; it records in which thread that happens."""

    def __init__(self, woken, threads):
        self.woken, self.threads = woken, threads

    def __del__(self):
        self.threads.append(threading.current_thread())
        self.woken.wait(SLEEP)


def in_the_answer(sleeper, view):
    answer = Misbehaving(lambda good: good).predict(view)
    object.__setattr__(answer, "sleeper", sleeper)
    return answer


def in_a_bad_answer(sleeper, view):
    return sleeper


def in_an_error(sleeper, view):
    raise RuntimeError(sleeper)


def in_the_frame_of_an_error(sleeper, view):
    raise RuntimeError("the traceback refers to this call, and so to the sleeper")


class Unreadable:
    def __init__(self, sleeper):
        self.sleeper = sleeper

    def __array__(self, *_args, **_kwargs):
        raise ValueError("the traceback refers to this object")


def in_an_error_from_reading(sleeper, view):
    return dataclasses.replace(in_the_answer(None, view), p_free=Unreadable(sleeper))


def in_the_view(sleeper, view):
    view.known.__dict__["sleeper"] = sleeper
    return in_the_answer(None, view)


@pytest.fixture
def woken():
    event = threading.Event()
    yield event
    event.set()


def late_answers(asker, count):
    """Ask several times, and count the answers that are late."""
    grid = straight().world.grid
    late = 0
    for _ in range(count):
        with contextlib.suppress(BadPredictionError):
            try:
                asker.ask(View(grid, np.zeros(3)), 0.05)
            except LateError:
                late += 1
    return late


@pytest.mark.parametrize(
    "keep",
    [
        in_the_answer,
        in_a_bad_answer,
        in_an_error,
        in_the_frame_of_an_error,
        in_an_error_from_reading,
        in_the_view,
    ],
)
def test_what_a_predictor_makes_is_destroyed_in_its_thread_and_nobody_waits(keep, woken):
    threads = []

    class Leaves:
        def predict(self, view):
            return keep(Sleeper(woken, threads), view)

    started = time.monotonic()
    assert late_answers(Asker(Leaves()), 5) >= 4
    assert time.monotonic() - started < SLEEP / 2
    assert [thread.name for thread in threads] == ["predictor"]


@pytest.mark.parametrize("part", ["property", "__array__"])
def test_nobody_waits_for_an_answer_that_takes_long_to_be_read(part, woken):
    class Slow(Prediction):
        @property
        def p_free(self):
            woken.wait(SLEEP)

    class SlowArray:
        def __array__(self, *_args, **_kwargs):
            woken.wait(SLEEP)

    class Answers:
        def predict(self, view):
            good = Misbehaving(lambda good: good).predict(view)
            if part == "__array__":
                return dataclasses.replace(good, p_free=SlowArray())
            slow = object.__new__(Slow)
            slow.__dict__["frame"] = good.frame
            return slow

    started = time.monotonic()
    assert late_answers(Asker(Answers()), 5) == 5
    assert time.monotonic() - started < SLEEP / 2


HANGS_FOR_GOOD = """
import sys, time
sys.path[:0] = sys.argv[1:]
from test_faults import EpisodeConfig, Misbehaving, drive, navigator, straight

started = time.monotonic()


def hangs(good):
    time.sleep(0 if hangs.calls < 2 else 40)
    return good


class Hangs(Misbehaving):
    def predict(self, view):
        hangs.calls = self.calls
        return super().predict(view)


task = straight()
drive(task, navigator(task, Hangs(hangs), reliance=0.3, deadline=0.05), EpisodeConfig(timeout=0.3))
print("driven", flush=True)
"""


def test_a_predictor_that_hangs_for_good_does_not_keep_the_program_from_ending():
    here = Path(__file__).parent
    done = subprocess.run(
        [sys.executable, "-c", HANGS_FOR_GOOD, str(here), str(here.parent / "support")],
        capture_output=True,
        text=True,
        timeout=20,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "driven" in done.stdout


def scans_that_are_bad():
    nan = np.full(541, np.nan)
    good = LIDAR.scan(straight().world, (2.0, 2.0, 0.0))
    return {
        "nan": dataclasses.replace(good, ranges=nan),
        "none": None,
        "text": "a scan",
        "empty": dataclasses.replace(good, ranges=np.empty(0)),
        "ranges of none": dataclasses.replace(good, ranges=None),
        "a list": dataclasses.replace(good, ranges=good.ranges.tolist()),
        "objects": dataclasses.replace(good, ranges=good.ranges.astype(object)),
        "two-dimensional": dataclasses.replace(good, ranges=good.ranges[None]),
        "negative": dataclasses.replace(good, ranges=-good.ranges),
        "minus infinity": dataclasses.replace(good, ranges=np.full(541, -np.inf)),
        "angles of nan": dataclasses.replace(good, angle_min=math.nan),
        "increment of infinity": dataclasses.replace(good, angle_increment=math.inf),
        "range_max of zero": dataclasses.replace(good, range_max=0.0),
        "range_max of none": dataclasses.replace(good, range_max=None),
        "mount of nan": Scan(
            good.ranges, good.angle_min, good.angle_increment, 20.0, (math.nan, 0.0, 0.0)
        ),
    }


SILENT = ("nan", "negative", "minus infinity")


@pytest.mark.parametrize("kind", scans_that_are_bad())
def test_a_car_that_gets_bad_scans_comes_to_rest_in_what_it_has_seen(kind):
    task = straight()
    driver = navigator(task)
    car, bad = DubinsCar(), scans_that_are_bad()[kind]
    state = np.array([*task.start, 0.0])
    for tick in range(45):
        scan = LIDAR.scan(task.world, state) if tick < 12 else bad
        decision = driver.step(state, scan)
        assert np.isfinite(dataclasses.astuple(decision.control)).all()
        assert not car.collides(task.world, state, decision.control, 0.1)
        state = car.step(state, decision.control, 0.1)
        if tick == 11:
            assert state[3] > 0.5
    assert state[3] < 0.05
    # A beam may say nothing, and so may all of them.
    assert driver.faults["bad_scan"] == (0 if kind in SILENT else 33)


def raising(error):
    def call(*_args, **_kwargs):
        raise error

    return call


def nowhere(state, _path, _risk, guess, *_):
    """A solver that loses itself, and says so."""
    plan = Plan(np.full((len(guess) + 1, 4), math.nan), guess)
    return Solution(plan, math.nan, Status.NOT_FINITE)


SOLVERS = {
    "value error": raising(ValueError("not finite")),
    "runtime error": raising(RuntimeError("an assertion of casadi's")),
    "memory": raising(MemoryError()),
    "not finite": nowhere,
}


def driven(task, driver, ticks, go_wrong):
    """Decision of each tick and state after it; from tick 15 on something is wrong."""
    car, state = DubinsCar(), np.array([*task.start, 0.0])
    for tick in range(ticks):
        if tick == 15:
            assert state[3] > 0.5
            go_wrong()
        decision = driver.step(state, LIDAR.scan(task.world, state))
        assert not car.collides(task.world, state, decision.control, 0.1)
        state = car.step(state, decision.control, 0.1)
        yield decision, state


@pytest.mark.parametrize("kind", SOLVERS)
def test_a_car_whose_solver_fails_comes_to_rest_and_counts_it(kind):
    task = straight()
    driver = navigator(task)
    fail = functools.partial(setattr, driver.chooser.mpc, "solve", SOLVERS[kind])
    decisions, states = zip(*driven(task, driver, 60, fail), strict=True)
    assert not any(decision.emergency for decision in decisions)
    assert driver.faults["solver_failed"] == driver.faults["no_safe_solution"] == 45
    assert states[-1][3] < 0.05


def test_a_car_whose_qps_fail_goes_on_by_its_guesses_where_they_are_safe():
    task = straight()
    driver = navigator(task)

    def solve(state, _path, _risk, guess, *_):
        return Solution(driver.chooser.mpc.roll(state, guess), math.nan, Status.QP_FAILED)

    driver.chooser.mpc.solve = solve
    episode = drive(task, driver)
    assert episode.outcome is Outcome.REACHED
    # There is a path from the first tick on, and so something to solve in each.
    assert episode.faults["solver_failed"] == len(episode.trace["controls"])


@pytest.mark.parametrize("part", ["find_route", "Smoother.along", "CostMap.build"])
def test_a_car_whose_path_search_fails_goes_on_along_the_last_path_and_counts_it(monkeypatch, part):
    task = straight()
    driver = navigator(task)
    search = raising(RuntimeError("a search's"))
    fail = functools.partial(monkeypatch.setattr, f"planner.guide.path_search.{part}", search)
    *_, (_, state) = driven(task, driver, 140, fail)
    assert driver.faults["path_failed"] > 3
    assert math.hypot(state[0] - task.goal[0], state[1] - task.goal[1]) < 1.0
    assert state[3] < 0.05


@pytest.mark.parametrize("error", [RuntimeError("a search's"), MemoryError()])
def test_a_car_whose_first_path_search_fails_stands_and_tries_again(monkeypatch, error):
    task = straight()
    driver = navigator(task)
    state = np.array([*task.start, 0.0])
    with monkeypatch.context() as broken:
        broken.setattr("planner.guide.path_search.find_route", raising(error))
        decision = driver.step(state, LIDAR.scan(task.world, state))
        assert decision.path is None
        assert decision.faults == ("path_failed",)
    for _ in range(20):
        decision = driver.step(state, LIDAR.scan(task.world, state))
        state = DubinsCar().step(state, decision.control, 0.1)
    assert state[3] > 0.5


def test_braking_hard_is_counted_also_where_there_is_no_path(monkeypatch):
    monkeypatch.setattr("planner.guide.path_search.find_route", lambda *_: None)
    task = straight()
    driver = navigator(task)
    state = np.array([*task.start, 4.0])
    decision = driver.step(state, LIDAR.scan(task.world, state))
    assert decision.path is None
    assert decision.emergency
    assert decision.faults.count("emergency") == 1
    assert driver.faults["emergency"] == 1


def test_the_page_on_faults_lists_each_fault_with_its_meaning():
    page = (Path(__file__).parents[2] / "docs/reference/faults.md").read_text()
    listed = re.findall(r"`([a-z_]+)`", "".join(re.findall(r"(?m)^\| (`[^|]*)\|", page)))
    assert sorted(listed) == sorted(Fault)
