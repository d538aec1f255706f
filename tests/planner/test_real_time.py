"""A slow search never delays the control, and without a clock nothing depends on the executor."""

import os
import signal
import threading
import time
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
)
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from short_drive import LIDAR, drive, navigator, straight

from foresee.prediction import Prediction
from planner.guide import search_process
from planner.guide.search_process import SearchProcess
from sim import DubinsCar, generate, sample_task
from sim.episode import EpisodeConfig


class Withheld(Executor):
    """Keeps each call until it is let go: a search that takes as long as the test wants."""

    def __init__(self):
        self.kept = []

    def submit(self, call, /, *args):
        future = Future()
        self.kept.append((future, call, args))
        return future

    def let_go(self):
        for future, call, args in self.kept:
            future.set_result(call(*args))
        self.kept = []


class Joined(ThreadPoolExecutor):
    """Runs the searches in a thread, and waits for the last one when it is told to."""

    last = None

    def submit(self, call, /, *args):
        first = self.last is None
        self.last = super().submit(call, *args)
        if first:
            self.join()
        return self.last

    def join(self):
        self.last.exception()


def beside(task, executor, **changes):
    driver = navigator(task, **changes)
    driver.guide._executor = executor
    return driver


def masked():
    return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def test_ctrl_c_does_not_reach_the_process_of_the_searches_while_it_starts():
    process = SearchProcess()
    assert process.submit(masked).result()
    process.shutdown()


def test_a_search_that_never_ends_delays_no_step_and_the_last_path_is_driven_safely():
    task, search = straight(), Withheld()
    driver = beside(task, search)
    state = np.array([*task.start, 0.0])

    def ticks(count):
        nonlocal state
        for _ in range(count):
            # It returns, although no search does.
            decision = driver.step(state, LIDAR.scan(task.world, state))
            assert not decision.emergency
            assert driver.chooser.checker.is_safe(decision.plan, decision.risk_map)
            assert not DubinsCar().collides(task.world, state, decision.control, 0.1)
            state = DubinsCar().step(state, decision.control, 0.1)
        return decision

    # Without any path the car stands, and one search is under way.
    assert ticks(5).path is None
    assert state[3] == 0.0
    assert len(search.kept) == 1
    search.let_go()
    first = ticks(1).path
    assert first is not None
    speeds, paths = [], []
    for _ in range(60):
        paths.append(ticks(1).path)
        speeds.append(state[3])
    # The first path is all that there is, and the car reaches its end on it.
    assert max(speeds) > 1.5
    assert all(path.points[0] == pytest.approx(first.points[0]) for path in paths)
    assert len(search.kept) == 1


def test_a_path_is_adopted_in_the_first_tick_in_which_it_is_ready():
    task, search = straight(), Withheld()
    driver = beside(task, search)
    state = np.array([*task.start, 0.0])
    for late in (0, 3):
        for _ in range(late + 1):
            driver.step(state, LIDAR.scan(task.world, state))
            assert not driver.guide.is_new
        search.let_go()
        driver.step(state, LIDAR.scan(task.world, state))
        assert driver.guide.is_new
        # The next one is requested when it is due.
        while not search.kept:
            driver.step(state, LIDAR.scan(task.world, state))


@pytest.mark.parametrize("family", ["corridor", "office"])
def test_a_drive_whose_searches_run_in_a_thread_is_the_same_to_the_bit_if_each_is_joined(family):
    task = sample_task(generate(family, 1), 1)
    config = EpisodeConfig(timeout=0.5)
    expected = drive(task, navigator(task), config).trace
    with Joined(1) as pool:
        driver = beside(task, pool)
        step = driver.step

        def joined(state, scan):
            if pool.last is not None:
                pool.join()
            return step(state, scan)

        driver.step = joined
        trace = drive(task, driver, config).trace
    for name in expected:
        if name != "times":
            assert np.array_equal(expected[name], trace[name]), name


def test_a_search_process_that_dies_costs_a_path_and_is_replaced():
    task, process = straight(), SearchProcess()
    driver = beside(task, process)
    state = np.array([*task.start, 0.0])
    try:
        killed = process.submit(os.kill, process.submit(os.getpid).result(), signal.SIGKILL)
        assert killed.exception() is not None
        driver.step(state, LIDAR.scan(task.world, state))
        driver.guide._running.result()
        assert driver.step(state, LIDAR.scan(task.world, state)).path is not None
        # The one that is under way dies, too.
        pid = process.submit(os.getpid).result()
        broken = driver.guide._running = process.submit(os.kill, pid, signal.SIGKILL)
        assert broken.exception() is not None
        assert "path_failed" in driver.step(state, LIDAR.scan(task.world, state)).faults
    finally:
        process.shutdown()


class Watched:
    """Tells when it is pickled."""

    def __init__(self):
        self.threads = []

    def __reduce__(self):
        self.threads.append(threading.current_thread())
        return list, ()


def test_what_a_search_is_given_may_change_as_soon_as_it_has_started():
    process, given = SearchProcess(), Watched()
    try:
        assert process.submit(len, given).result() == 0
    finally:
        process.shutdown()
    # A thread that pickles it later would read it while it changes.
    assert given.threads == [threading.current_thread()]


def test_a_search_that_does_not_end_is_ended(monkeypatch):
    monkeypatch.setattr(search_process, "LONGEST", 0.2)
    process = SearchProcess()
    try:
        stuck = process.submit(time.sleep, 1e6)
        assert isinstance(stuck.exception(timeout=30.0), BrokenExecutor)
        assert process.submit(abs, -1).result() == 1
    finally:
        process.shutdown()


def searches():
    SearchProcess()
    kept.append(SearchProcess())
    return os.getpid()


kept = []


def test_a_process_that_has_a_search_process_ends():
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        pid = pool.submit(searches).result()
    # It would never end if it waited for its search process.
    assert not Path(f"/proc/{pid}").exists()


def test_a_withdrawn_decision_leaves_what_was_kept_before():
    task = straight()
    drivers = navigator(task), navigator(task)
    state = np.array([*task.start, 0.0])
    for _ in range(15):
        decisions = [driver.step(state, LIDAR.scan(task.world, state)) for driver in drivers]
        state = DubinsCar().step(state, decisions[0].control, 0.1)
    late, plain = drivers
    taken = late.step(state, LIDAR.scan(task.world, state)).times
    late.withdraw()
    for tick in range(20):
        skipped = late.skip()
        assert skipped.control == plain.skip().control
        # Only the first of these ticks has taken time: that of the late decision.
        assert skipped.times == ({} if tick else taken)


class Slow:
    """Believes that all is free, and from the second answer on only when it is told to."""

    def __init__(self):
        self.asked, self.may, self.answered = 0, threading.Semaphore(1), threading.Semaphore(0)

    def predict(self, view):
        self.asked += 1
        self.may.acquire()
        self.answered.release()
        ones = np.ones(view.known.frame.shape, np.float32)
        return Prediction(view.known.frame, ones, 0 * ones, ones)


def test_a_late_prediction_counts_for_what_was_not_observed_since():
    task, slow = straight(), Slow()
    driver = navigator(task, slow, reliance=0.1, deadline=0.001)
    state = np.array([*task.start, 0.0])

    def step():
        nonlocal state
        decision = driver.step(state, LIDAR.scan(task.world, state))
        state = DubinsCar().step(state, decision.control, 0.1)
        return decision

    first = step()
    assert first.faults == ()
    for _ in range(10):
        late = step()
        assert late.faults == ("predictor_late",)
        # It is still the first answer, as there is no other.
        assert late.prediction is first.prediction
        risk = late.risk_map
        assert (risk.safe & risk.known.unknown).any()
        assert not (risk.safe & risk.known.occupied).any()
    assert slow.asked == 2
    slow.may.release()
    driver._predictor.asker._thread.join()
    # The answer to the second question is there, while the third one waits.
    assert step().faults == ("predictor_late",)
    newest = driver._predictor._newest
    assert newest is not first.prediction
    slow.may.release()
