"""The peers solve the problem that ours solves, and are timed alike."""

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
    for prepare in (peers_mpc.ours(mpc), peers_mpc.general(mpc, "ipopt", compiled=False)):
        plan = mpc.roll(state, prepare(state, risk, guess, 0.0, True)())
        assert plan.states[-1, 3] < 1e-3
        costs.append(mpc.evaluate(plan, path, risk, 58, 0.0))
    started = mpc.evaluate(mpc.roll(state, guess), path, risk, 58, 0.0)
    assert costs[0] == pytest.approx(costs[1], rel=5e-3)
    assert max(costs) < started


def test_a_general_solver_drives_as_ours_does():
    mpc = MPC(config=peers_mpc.COST_ONLY)
    solvers = (peers_mpc.ours(mpc), peers_mpc.general(mpc, "ipopt", compiled=False))
    drives = [peers_mpc.drive(mpc, solver, 5, 12) for solver in solvers]
    assert drives[0].cost == pytest.approx(drives[1].cost, rel=5e-3)
    assert [d.failures for d in drives] == [0, 0]
    assert [len(d.times) for d in drives] == [11, 11]


def test_calls_are_timed_in_turn(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(peers.time, "perf_counter", lambda: now[0])
    order = []

    def call(name, seconds):
        def run(i):
            order.append((name, i))
            now[0] += seconds * (100 if order.count((name, 0)) == 1 and i == 0 else 1)

        return run

    found = peers.compare({peers.OURS: call("a", 0.001), "other": call("b", 0.01)}, 5)
    assert order[:4] == [("a", 0), ("b", 0), ("a", 0), ("b", 0)]
    assert found[peers.OURS] == pytest.approx({"median_ms": 1.0, "p99_ms": 1.0, "ratio": 1.0})
    assert found["other"]["ratio"] == pytest.approx(10.0)
    assert "| rays | other |" in peers_table({"rays": found})


def test_peers_of_the_lidar_see_what_ours_sees():
    for name in ("octomap", "raycast2D", "irsim"):
        pytest.importorskip(name)
    world = task_in("corridor", 0, CarConfig()).world
    poses = _poses(task_in("corridor", 0, CarConfig()), 3)
    calls = peers.rays(world, poses)
    for i, pose in enumerate(poses):
        scan = calls[peers.OURS](i)
        angle = pose[2] + scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
        met = np.isfinite(scan.ranges)
        hits = pose[:2] + scan.ranges[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        by_tree = np.hypot(*(calls["octomap-python"](i) - hits).T)
        assert np.nanmedian(by_tree[met]) < 0.05
        pixels = calls["raycast2D"](i)
        origin, resolution = world.grid.frame.origin, world.grid.frame.resolution
        by_pixel = np.hypot(*((pixels + 0.5) * resolution + origin - hits).T)
        assert np.nanmedian(by_pixel[met]) < 0.1
        assert np.nanmedian(abs(calls["ir-sim"](i) - scan.ranges)[met]) < 0.1


def test_peers_of_the_map_find_the_walls_that_ours_finds():
    pytest.importorskip("octomap")
    pytest.importorskip("pyoctomap")
    task = task_in("corridor", 0, CarConfig())
    for name, call in peers.mapping(task, _poses(task, 2)).items():
        assert call(0) is not False, name
