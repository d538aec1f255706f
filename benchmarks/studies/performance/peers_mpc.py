"""Comparison of the MPC with other solvers of the same problem, each in its own closed loop.

The problem is that of `planner.mpc.mpc` along a straight path through a hall with posts: once with
a cost of small clearances only, and once also with the clearance as a constraint, as in normal
driving. All solvers drive through the same halls. From the second tick on, each solver solves from
the states that it has led to itself.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.performance.hall import (
    HallDrive,
    Solve,
    Solver,
    Tick,
    drive,
    segment_at,
    straight,
)
from benchmarks.studies.performance.peers_casadi import general
from benchmarks.studies.performance.peers_mppi import mppi
from benchmarks.studies.performance.stage_times import OURS, beside_ours
from foresee.statistics import grouped_mean
from planner.mpc.mpc import MPC, MPCConfig
from planner.navigator import FRESH_GUESS_TICKS

CONSTRAINED = MPCConfig()
"""Settings as in normal driving, with the clearance as a constraint."""
COST_ONLY = MPCConfig(margin=-5.0, comfort=5.0 + CONSTRAINED.margin + CONSTRAINED.comfort)
"""Settings without a constraint on the clearance, with the same cost of small clearances."""
ASIDE = (0.0, 1.2, -1.2)
"""Distances from the hall's middle of the paths that are pursued, in turn, for further first
guesses [m]."""


def ours(mpc: MPC) -> Solver:
    """Return the solver of `planner.mpc.mpc`, from one first guess."""
    path = straight()

    def prepare(tick: Tick) -> Solve:
        segment = segment_at(tick.state[0])

        def solve() -> NDArray[np.float64] | None:
            solution = mpc.solve(tick.state, path, tick.risk, tick.guess, segment, tick.last)
            return None if solution.failed else solution.plan.controls

        return solve

    return prepare


def in_turn(mpc: MPC, solver: Solver, afresh: Solver) -> Solver:
    """Return a solver that also tries another first guess every `FRESH_GUESS_TICKS` ticks.

    Args:
        mpc: MPC whose costs decide which solution is used.
        solver: solver that continues from the last plan.
        afresh: another instance of the same solver for the other first guesses, so that neither
            disturbs what the other one keeps from tick to tick. The guesses pursue the paths of
            `ASIDE`, in turn.
    """
    path, pursued = straight(), [straight(aside) for aside in ASIDE]
    ticks = 0

    def prepare(tick: Tick) -> Solve:
        nonlocal ticks
        ticks = 0 if tick.is_first else ticks + 1
        solves = [solver(tick)]
        turn, between = divmod(ticks, FRESH_GUESS_TICKS)
        if between == 0:
            aside = pursued[turn % len(pursued)]
            guess = mpc.pursue(tick.state, aside, segment_at(tick.state[0]))
            solves.append(afresh(replace(tick, guess=guess, is_first=True)))
        segment = segment_at(tick.state[0])

        def cost(controls: NDArray[np.float64]) -> float:
            plan = mpc.roll(tick.state, controls)
            return mpc.evaluate(plan, path, tick.risk, segment, tick.last)

        def solve() -> NDArray[np.float64] | None:
            solutions = [controls for each in solves if (controls := each()) is not None]
            return solutions[0] if len(solutions) == 1 else min(solutions, key=cost, default=None)

        return solve

    return prepare


def compare(
    config: MPCConfig, worlds: int, ticks: int, report: Callable[[str], None]
) -> dict[str, dict[str, float]]:
    """Drive with each solver in closed loop through the same halls.

    Args:
        config: settings of the problem.
        worlds: number of halls.
        ticks: number of ticks of each drive.
        report: function that shows what is being done.

    Returns:
        Solver → its times as in `beside_ours`; and `excess`, the mean over halls of the cost above
        that of a drive without posts; `dearer_percent`, the mean over halls of the cost above that
        of our MPC [%], and `dearer_low`, `dearer_high`, its 95 % interval over halls, if there is
        one; `hits`, the
        number of drives that hit a post; `failures`, the number of ticks in which the solver
        reported a failure.
    """
    mpc = MPC(config=config)
    # casadi writes compiled code into the working directory, and needs it there.
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        solvers = {}
        for name, make in makers(mpc).items():
            report(f"making {name}" + (", which takes minutes" if "compiled" in name else ""))
            solvers[name] = make()
        drives: dict[str, list[HallDrive]] = {name: [] for name in solvers}
        for seed in range(worlds):
            for name, solver in solvers.items():
                report(f"{name} in hall {seed + 1} of {worlds}")
                drives[name].append(drive(mpc, solver, seed, ticks))
    compared = beside_ours({name: [t for d in ds for t in d.times] for name, ds in drives.items()})
    reference = np.array([d.cost for d in drives[OURS]])
    # The zero of the cost is arbitrary, so the cost without posts is subtracted.
    unhindered = drive(mpc, ours(mpc), None, ticks).cost
    for name, ds in drives.items():
        costs = np.array([d.cost for d in ds])
        dearer = 100 * (costs - reference) / abs(reference)
        interval = grouped_mean(np.arange(worlds), dearer, np.ones(worlds))
        assert interval is not None
        ends = {"dearer_low": interval["low"], "dearer_high": interval["high"]}
        compared[name] |= {
            "excess": float((costs - unhindered).mean()),
            "dearer_percent": interval["value"],
            **{end: value for end, value in ends.items() if value is not None},
            "hits": float(sum(d.hit for d in ds)),
            "failures": float(sum(d.failures for d in ds)),
        }
    return compared


def makers(mpc: MPC) -> dict[str, Callable[[], Solver]]:
    """Return name → function that makes the solver; compiled solvers take minutes to make."""

    def fatrop() -> Solver:
        return general(mpc, "fatrop", compiled=True)

    return {
        OURS: lambda: ours(mpc),
        "ours, starts in turn": lambda: in_turn(mpc, ours(mpc), ours(mpc)),
        "IPOPT": lambda: general(mpc, "ipopt", compiled=False),
        "IPOPT, compiled": lambda: general(mpc, "ipopt", compiled=True),
        "fatrop, compiled": fatrop,
        "fatrop, compiled, starts in turn": lambda: in_turn(mpc, fatrop(), fatrop()),
        "pytorch_mppi": lambda: mppi(mpc),
    }
