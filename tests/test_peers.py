"""The peers solve the problem that ours solves, and are timed alike."""

import time

import numpy as np
import pytest

from benchmarks import peers, peers_mpc
from benchmarks.drive import task_in
from benchmarks.stages import _poses, peers_table
from planner.guess import pursue
from planner.mpc import MPC
from sim import CarConfig


def test_a_general_solver_finds_the_plan_that_ours_finds():
    mpc = MPC(config=peers_mpc.COST_ONLY)
    path, risk = peers_mpc.straight(), peers_mpc._around(peers_mpc.hall(3), np.array([4.0, 0, 0]))
    state, car = np.array([4.0, 0.3, 0.1, 2.0]), mpc.limits
    guess = pursue(path.points, 60, state, mpc.stages, 0.1, car.v_max, car.acceleration,
                   car.braking, car.lateral_acceleration, car.max_curvature, 1e6)  # fmt: skip
    costs = []
    for solve in (peers_mpc.ours(mpc), peers_mpc.general(mpc, "ipopt", compiled=False)):
        plan = mpc.roll(state, solve(state, risk, guess, 0.0))
        assert plan.states[-1, 3] < 1e-3
        costs.append(mpc.evaluate(plan, path, risk, 58, 0.0))
    started = mpc.evaluate(mpc.roll(state, guess), path, risk, 58, 0.0)
    assert costs[0] == pytest.approx(costs[1], rel=5e-3)
    assert max(costs) < started


def test_calls_are_timed_in_turn():
    order = []

    def call(name, seconds):
        def run(i):
            order.append((name, i))
            time.sleep(seconds)

        return run

    found = peers.compare({peers.OURS: call("a", 0.001), "other": call("b", 0.01)}, 5)
    assert order[:4] == [("a", 0), ("b", 0), ("a", 0), ("b", 0)]
    assert found[peers.OURS]["ratio"] == 1.0
    assert 3 < found["other"]["ratio"] < 12
    assert "| rays | other |" in peers_table({"rays": found})


def test_peers_of_the_sensor_and_the_map_see_what_ours_sees():
    pytest.importorskip("octomap")
    pytest.importorskip("raycast2D")
    pytest.importorskip("irsim")
    pytest.importorskip("pyoctomap")
    task = task_in("corridor", 0, CarConfig())
    poses = _poses(task, 2)
    for calls in (peers.rays(task.world, poses), peers.mapping(task, poses)):
        assert peers.OURS in calls
        assert len(calls) >= 3
        for call in calls.values():
            call(1)
