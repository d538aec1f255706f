"""The hall in which solvers of the MPC's problem are compared."""

import math

from benchmarks.studies.performance.hall import drive
from benchmarks.studies.performance.peers_mpc import ours
from planner.mpc.mpc import MPC


def test_a_drive_that_is_longer_than_a_plan_has_a_cost():
    mpc = MPC()
    ticks = mpc.stages + 10
    driven = drive(mpc, ours(mpc), 1, ticks)
    assert math.isfinite(driven.cost)
    assert (len(driven.times), driven.failures, driven.hit) == (ticks - 1, 0, False)
