"""A predictor in a process of its own answers as in a thread, and can do no harm."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import misbehaving
import numpy as np
import pytest
from joblib import Parallel, delayed
from misbehaving import Forks, Misbehaving, Raises, Wrong, random_view
from short_drive import LIDAR, drive, navigator, straight

from foresee.prediction import BadPredictionError, RaisedError
from planner.risk import predictor_process
from planner.risk.ask_predictor import Asker, LateError
from planner.risk.predictor_process import PredictorProcess
from predictor.extend import Extend
from predictor.registry import load_predictor
from sim import DubinsCar
from sim.episode import EpisodeConfig

BOUND = 60.0
"""Time that is far longer than what is tested, and far shorter than a predictor that hangs [s]."""
FIELDS = ("p_free", "p_occupied", "confidence")


@pytest.fixture
def started():
    """Function that starts a predictor in a process, which ends after the test."""
    with contextlib.ExitStack() as stack:

        def start(factory, *arguments):
            predictor = PredictorProcess(factory, *arguments)
            stack.callback(predictor.close)
            return predictor

        yield start


def process_of(predictor):
    return predictor._server._process.pid


def is_alive(pid):
    """Whether a process lives; one that has ended but was not waited for does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_for(condition):
    started = time.monotonic()
    while not condition():
        assert time.monotonic() - started < BOUND
        time.sleep(0.05)


def answered(predictor):
    with contextlib.suppress(LateError, BadPredictionError):
        return predictor.ask(random_view(), 1.0)


@pytest.mark.parametrize("name", ["extend", "compact"])
def test_the_answers_are_those_in_a_thread_to_the_bit(started, name):
    alone, thread = started(load_predictor, name), Asker(load_predictor(name))
    assert alone.context_side == thread.context_side
    for side, seed in ((60, 0), (60, 1), (100, 2), (40, 3)):
        asked = random_view(side, seed)
        one, other = alone.ask(asked, BOUND), thread.ask(asked, BOUND)
        assert one.frame == other.frame
        for field in FIELDS:
            assert np.array_equal(getattr(one, field), getattr(other, field))
            assert getattr(one, field).dtype == np.float32


def test_a_doubt_arrives_and_a_reply_that_is_none_is_a_bad_prediction(started):
    predictor = started(Misbehaving, misbehaving.crashes)
    view = random_view()
    assert predictor.ask(view, BOUND).doubt == 3.0
    for reply in (3, [0], "free", None, [0, 1.0, 2.0]):
        with pytest.raises(BadPredictionError, match="process answered"):
            predictor._answer(view.known, "answer", reply)
    for doubt in (0.5, "2", None, 10**400):
        with pytest.raises(BadPredictionError, match="doubt is"):
            predictor._answer(view.known, "answer", [0, doubt])


def test_a_drive_is_the_same_as_with_a_thread(started):
    one, other = (
        drive(
            straight(),
            navigator(straight(), p, reliance=0.3, steer=True),
            EpisodeConfig(timeout=1.0),
        )
        for p in (started(Extend), Extend())
    )
    assert np.array_equal(one.trace["states"], other.trace["states"])
    assert one.faults == other.faults


def test_a_late_answer_is_that_to_its_own_question_and_is_given_once(started):
    predictor, asked, taken = started(load_predictor, "extend"), random_view(100, 2), []
    with pytest.raises(LateError):
        predictor.ask(asked, 0.0)

    def is_taken():
        taken.append(predictor.take_late())
        return taken[-1] is not None

    wait_for(is_taken)
    expected = Extend().predict(asked)
    assert taken[-1].frame == asked.known.frame
    unseen = asked.known.unknown
    assert np.array_equal(taken[-1].p_free[unseen], expected.p_free[unseen])
    assert predictor.take_late() is None
    assert predictor.ask(random_view(60, 1), BOUND).frame == random_view(60, 1).known.frame


@pytest.mark.parametrize("error", [KeyboardInterrupt, GeneratorExit, BaseException, SystemExit])
def test_no_exception_ends_the_process(started, error):
    predictor = started(Misbehaving, Raises(error))
    before = process_of(predictor)
    for _ in range(2):
        predictor.ask(random_view(), BOUND)
    for _ in range(3):
        with pytest.raises(RaisedError, match=error.__name__):
            predictor.ask(random_view(), BOUND)
    assert process_of(predictor) == before


MISBEHAVIOURS = {
    misbehaving.holds_the_lock: "predictor_late",
    misbehaving.spins: "predictor_late",
    misbehaving.prints_and_hangs: "predictor_late",
    misbehaving.ignores_signals: "predictor_late",
    misbehaving.forks_and_hangs: "predictor_late",
    misbehaving.crashes: "predictor_raised",
    misbehaving.exits: "predictor_raised",
    misbehaving.kills_itself: "predictor_raised",
    misbehaving.exhausts_its_memory: "predictor_raised",
    misbehaving.closes_everything: "predictor_raised",
    misbehaving.raises: "predictor_raised",
}


@pytest.mark.parametrize("misbehave", MISBEHAVIOURS, ids=lambda f: f.__name__)
def test_no_misbehaviour_delays_the_control_cycle_and_each_is_counted(started, misbehave):
    task = straight()
    predictor = started(Misbehaving, misbehave)
    for _ in range(2):
        predictor.ask(random_view(), BOUND)
    driver = navigator(task, predictor, reliance=0.3, deadline=0.05)
    # The navigator would wait for the first prediction longer than any test.
    driver._tick = 0
    state, before = np.array([*task.start, 0.0]), time.monotonic()
    ticks = 15
    for _ in range(ticks):
        decision = driver.step(state, LIDAR.scan(task.world, state))
        assert not DubinsCar().collides(task.world, state, decision.control, 0.1)
        state = DubinsCar().step(state, decision.control, 0.1)
    assert time.monotonic() - before < BOUND
    counted = {k: n for k, n in driver.faults.items() if k.startswith("predictor_")}
    assert sum(counted.values()) == ticks
    assert counted[MISBEHAVIOURS[misbehave]] >= 1


def test_an_answer_that_breaks_the_contract_and_an_exception_do_not_end_the_process(started):
    for predictor, error in (
        (started(Wrong), BadPredictionError),
        (started(Misbehaving, misbehaving.raises), RaisedError),
    ):
        process = process_of(predictor)
        for _ in range(4):
            with contextlib.suppress(BadPredictionError):
                predictor.ask(random_view(), BOUND)
        with pytest.raises(error, match=r"must return a Prediction|as in a thread"):
            predictor.ask(random_view(), BOUND)
        assert process_of(predictor) == process


@pytest.mark.parametrize("misbehave", [misbehaving.crashes, misbehaving.forks_and_hangs])
def test_a_process_that_has_failed_is_replaced_and_answers_again(
    started, monkeypatch, tmp_path, misbehave
):
    monkeypatch.setattr(predictor_process, "PAUSE", 0.01)
    predictor = started(Misbehaving, misbehave, tmp_path / "done")
    asked = [answered(predictor) for _ in range(2)]
    first = process_of(predictor)
    assert answered(predictor) is None
    wait_for(lambda: answered(predictor) is not None)
    assert asked[0] is not None
    assert process_of(predictor) != first
    assert not is_alive(first)


def test_the_pause_before_a_restart_doubles_and_a_good_answer_ends_this(started, monkeypatch):
    predictor = started(Misbehaving, misbehaving.crashes)
    pauses = []
    for _ in range(10):
        predictor._fail()
        pauses.append(predictor._retry - time.monotonic())
    assert np.allclose(pauses, [0.5, 1, 2, 4, 8, 16, 32, 60, 60, 60], atol=0.4)
    with pytest.raises(LateError):
        predictor.ask(random_view(), BOUND)
    predictor._retry = 0.0
    wait_for(lambda: answered(predictor) is not None)
    assert predictor._failures == 0


def test_a_predictor_that_forks_gives_one_answer(started):
    predictor = started(Forks)
    for seed in range(3):
        assert predictor.ask(random_view(60, seed), BOUND).p_free.shape == (60, 60)
    predictor._server._socket.settimeout(0.3)
    with pytest.raises(TimeoutError):
        predictor._server._socket.recv(100)


@pytest.mark.parametrize(
    ("factory", "arguments", "line"),
    [
        (misbehaving.fails, (), "there is no such network"),
        (load_predictor, ("no such name",), "no predictor is named 'no such name'"),
        (misbehaving.crashes, (), "process ended"),
        (str, (), r"no method predict\(view\)"),
    ],
)
def test_a_predictor_that_cannot_be_made_is_refused_in_one_line(factory, arguments, line):
    with pytest.raises(BadPredictionError, match=line):
        PredictorProcess(factory, *arguments)


PARENT = """
import contextlib, time
from misbehaving import Misbehaving, holds_the_lock, random_view
from planner.risk.predictor_process import LateError, PredictorProcess

predictor = PredictorProcess(Misbehaving, holds_the_lock)
for _ in range(2):
    predictor.ask(random_view(), 60.0)
print(predictor._server._process.pid, flush=True)
if {asks}:
    with contextlib.suppress(LateError):
        predictor.ask(random_view(), 0.1)
if {stays}:
    time.sleep(1000)
"""


@pytest.mark.parametrize("asks", [True, False], ids=["busy", "idle"])
@pytest.mark.parametrize("stays", [True, False], ids=["killed", "ends"])
def test_the_process_ends_with_its_parent_and_leaves_nothing(asks, stays):
    code = PARENT.format(asks=asks, stays=stays)
    support = str(Path(misbehaving.__file__).parent)
    paths = os.pathsep.join([support, *filter(None, [os.environ.get("PYTHONPATH")])])
    with subprocess.Popen(
        [sys.executable, "-X", "dev", "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": paths},
    ) as parent:
        child = int(parent.stdout.readline())
        if stays:
            assert is_alive(child)
            parent.send_signal(signal.SIGKILL)
        # The child holds the same standard error, so this also waits for its end.
        _, errors = parent.communicate(timeout=BOUND)
    assert parent.returncode == (-signal.SIGKILL if stays else 0)
    assert not any(word in errors for word in ("leaked", "ResourceWarning", "Traceback"))
    wait_for(lambda: not is_alive(child))


def answers_of_a_worker(seed):
    predictor = PredictorProcess(Extend)
    try:
        return predictor.ask(random_view(60, seed), BOUND).p_free
    finally:
        predictor.close()


@pytest.mark.slow(10)
def test_it_works_in_workers_of_joblib():
    found = Parallel(n_jobs=2)(delayed(answers_of_a_worker)(seed) for seed in range(2))
    for seed, p_free in enumerate(found):
        assert np.array_equal(p_free, Asker(Extend()).ask(random_view(60, seed), BOUND).p_free)


def test_a_closed_one_answers_no_more_and_its_process_has_ended(started):
    predictor = started(Extend)
    process = process_of(predictor)
    descriptors = len(os.listdir("/proc/self/fd"))
    predictor.close()
    predictor.close()
    assert not is_alive(process)
    assert len(os.listdir("/proc/self/fd")) == descriptors - 3
    with pytest.raises(LateError):
        predictor.ask(random_view(), 1.0)
