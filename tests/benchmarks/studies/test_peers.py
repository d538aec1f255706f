"""The peers solve the problem that ours solves, and are timed alike."""

import casadi as ca
import numpy as np
import pytest

from benchmarks.studies.performance import hall, peers, peers_mpc
from benchmarks.studies.performance.peers_casadi import clearance_function, general
from benchmarks.studies.performance.tables import peers_table
from planner.mpc.clearance import clearances
from planner.mpc.mpc import MPC
from planner.navigator import FRESH_GUESS_TICKS

PROBLEMS = {"cost only": peers_mpc.COST_ONLY, "kept inside": peers_mpc.CONSTRAINED}


def casadis(mpc):
    return general(mpc, "ipopt", compiled=False)


@pytest.mark.parametrize("problem", PROBLEMS)
def test_a_general_solver_finds_the_plan_that_ours_finds(problem):
    mpc = MPC(config=PROBLEMS[problem])
    path, risk = hall.straight(), hall.around(hall.hall(3), np.array([4.0, 0, 0]))
    state = np.array([4.0, 0.3, 0.1, 2.0])
    guess = mpc.pursue(state, path, hall.segment_at(state[0]))
    costs = []
    for prepare in (peers_mpc.ours(mpc), casadis(mpc)):
        plan = mpc.roll(state, prepare(hall.Tick(state, risk, guess, 0.0, True))())
        assert plan.states[-1, 3] < 1e-3
        costs.append(mpc.evaluate(plan, path, risk, 58, 0.0))
    started = mpc.evaluate(mpc.roll(state, guess), path, risk, 58, 0.0)
    assert costs[0] == pytest.approx(costs[1], rel=5e-3)
    assert max(costs) < started


def test_the_map_is_read_and_derived_as_ours_is():
    mpc, risk = MPC(), hall.around(hall.hall(3), np.array([4.0, 0, 0]))
    x = ca.MX.sym("x", 5)
    field = np.asarray(risk.clearance, dtype=np.float64)
    read = clearance_function(mpc)(x, ca.MX(risk.frame.origin), ca.MX(field.ravel()))
    read = ca.Function("read", [x], [read, ca.jacobian(read, x)])
    rng = np.random.default_rng(0)
    states = rng.uniform([2, -2, -3, 0], [8, 2, 3, 4], (50, 4))
    value, gradient = clearances(
        risk.frame.field(risk.clearance), states, mpc.limits.body.length / 4
    )
    for i, state in enumerate(states):
        got, derived = read([*state, 0.0])
        assert np.asarray(got).ravel() == pytest.approx(value[i], abs=1e-9)
        assert np.asarray(derived)[:, :3] == pytest.approx(gradient[i][:, :3], abs=1e-6)


def test_a_general_solver_drives_as_ours_does():
    mpc = MPC(config=peers_mpc.COST_ONLY)
    drives = [hall.drive(mpc, solver, 5, 12) for solver in (peers_mpc.ours(mpc), casadis(mpc))]
    assert drives[0].cost == pytest.approx(drives[1].cost, rel=5e-3)
    assert [d.failures for d in drives] == [0, 0]
    assert [len(d.times) for d in drives] == [11, 11]


def test_every_fifth_tick_the_cheaper_of_two_starts_is_driven():
    mpc = MPC(config=peers_mpc.CONSTRAINED)
    state, path = np.array([4.0, 0.3, 0.1, 2.0]), hall.straight()
    aside = mpc.pursue(state, hall.straight(2.4), hall.segment_at(state[0]))
    ours, starts = peers_mpc.ours(mpc), []

    def afresh(tick):
        # What a solver keeps from tick to tick is of another plan.
        assert tick.is_first
        starts.append(tick.guess)
        return ours(tick)

    def cost(controls, risk):
        return mpc.evaluate(mpc.roll(state, controls), path, risk, 58, 0.0)

    solver, cheaper = peers_mpc.in_turn(mpc, ours, afresh), 0
    for i in range(16):
        risk = hall.around(hall.hall(i), state)
        tick = hall.Tick(state, risk, aside, 0.0, i == 0)
        one, best = (cost(prepare(tick)(), risk) for prepare in (ours, solver))
        assert best == pytest.approx(one, abs=1e-9) if i % FRESH_GUESS_TICKS else best <= one + 1e-9
        cheaper += best < one - 1e-3
    assert cheaper > 0
    # The next drive begins with the first way again, whenever the last one ended.
    solver(hall.Tick(state, risk, aside, 0.0, True))()
    assert len(starts) == 5
    assert np.array_equal(starts[4], starts[0])
    starts.pop()
    # The three ways, and the first of them again.
    assert len(starts) == 4
    assert np.array_equal(starts[0], starts[3])
    assert not np.array_equal(starts[0], starts[1])


def test_where_one_start_fails_the_other_counts():
    mpc = MPC(config=peers_mpc.COST_ONLY)
    state = np.array([4.0, 0.3, 0.1, 2.0])
    tick = hall.Tick(state, hall.around(hall.hall(3), state), np.zeros((mpc.stages, 2)), 0.0, True)
    ours = peers_mpc.ours(mpc)

    def fails(tick):
        return lambda: None

    assert peers_mpc.in_turn(mpc, fails, ours)(tick)() is not None
    assert peers_mpc.in_turn(mpc, ours, fails)(tick)() is not None
    assert peers_mpc.in_turn(mpc, fails, fails)(tick)() is None


def test_sampling_keeps_the_limits_lowers_the_cost_and_repeats_itself():
    pytest.importorskip("pytorch_mppi")
    from benchmarks.studies.performance.peers_mppi import mppi

    mpc = MPC(config=peers_mpc.COST_ONLY)
    path, risk = hall.straight(), hall.around(hall.hall(3), np.array([4.0, 0, 0]))
    state = np.array([4.0, 0.3, 0.1, 2.0])
    guess = np.tile([-mpc.limits.braking, 0.0], (mpc.stages, 1))
    tick = hall.Tick(state, risk, guess, 0.0, True)
    prepare = mppi(mpc)
    first, again = (mpc.roll(state, prepare(tick)()) for _ in range(2))
    assert np.array_equal(first.controls, again.controls)
    started, ended = (
        mpc.evaluate(plan, path, risk, 58, 0.0) for plan in (mpc.roll(state, guess), first)
    )
    assert ended < started - 1.0


def test_what_posts_add_to_the_cost_is_told_beside_it(monkeypatch):
    monkeypatch.setattr(
        peers_mpc,
        "makers",
        lambda mpc: {"ours": lambda: peers_mpc.ours(mpc), "IPOPT": lambda: casadis(mpc)},
    )
    found = peers_mpc.compare(peers_mpc.COST_ONLY, 2, 8, lambda _: None)
    assert found["ours"]["ratio"] == 1.0
    assert found["ours"]["dearer_percent"] == 0.0
    assert found["ours"]["excess"] == pytest.approx(found["IPOPT"]["excess"], abs=0.1)
    assert found["ours"]["excess"] > -0.01
    # Two halls are too few for an interval.
    assert "dearer_low" not in found["IPOPT"]
    assert f"{found['IPOPT']['dearer_percent']:+.3f} %" in peers_table({"mpc": found})
    found["IPOPT"] |= {"dearer_percent": 0.5, "dearer_low": -0.1, "dearer_high": 1.1}
    assert "+0.500 (-0.100 to +1.100) %" in peers_table({"mpc": found})


def test_clearance_costs_up_to_where_it_does_in_driving():
    free, driving = (MPC(config=PROBLEMS[name]) for name in PROBLEMS)
    assert free.required < 0.0 < driving.required
    assert free.required + free.config.comfort == pytest.approx(
        driving.required + driving.config.comfort
    )
    assert free.config.closeness == driving.config.closeness


def test_calls_are_timed_in_turn(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(peers.time, "perf_counter", lambda: now[0])
    order = []

    def call(name, seconds):
        def run(i):
            order.append((name, i))
            now[0] += seconds * (100 if order.count((name, i)) == 1 and i in (0, 10) else 1)

        return run

    found = peers.compare({peers.OURS: call("a", 0.001), "other": call("b", 0.01)}, 12)
    turns = [[0, *range(10)], [10, 10, 11]]
    assert order == [(name, i) for turn in turns for name in "ab" for i in turn]
    assert found[peers.OURS] == pytest.approx({"median_ms": 1.0, "p99_ms": 1.0, "ratio": 1.0})
    assert found["other"]["ratio"] == pytest.approx(10.0)
    assert "| prediction | other |" in " ".join(peers_table({"prediction": found}).split())
