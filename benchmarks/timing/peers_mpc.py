"""The MPC beside other solvers: the same problem, and each solver's own closed loop.

The problem is that of `planner.mpc.mpc` along a straight path through a hall with posts: once with
its body kept off by cost alone, once with the clearance required that driving requires. Paired
are the halls: from the second tick on each solver's calls are of the states that it came to itself.
"""

from __future__ import annotations

import contextlib
import gc
import tempfile
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.runs.statistics import grouped_mean
from benchmarks.timing.hall import Drive, Solve, Solver, Tick, drive, pursuit, segment_at, straight
from benchmarks.timing.peers_casadi import general
from benchmarks.timing.peers_do_mpc import do_mpc
from benchmarks.timing.peers_mppi import mppi
from benchmarks.timing.timing import OURS, beside_ours
from planner.mpc.mpc import MPC, MPCConfig
from planner.navigator import AFRESH

CONSTRAINED = MPCConfig()
"""As in driving."""
COST_ONLY = MPCConfig(margin=-5.0, comfort=5.0 + CONSTRAINED.margin + CONSTRAINED.comfort)
"""Nothing is required of the clearance, and it costs up to where it does in driving."""
ASIDE = (0.0, 1.2, -1.2)
"""How far beside the hall's middle the ways run that further starts pursue, in turn [m]."""


def ours(mpc: MPC) -> Solver:
    """`planner.mpc.mpc`, from one guess."""
    path = straight()

    def prepare(tick: Tick) -> Solve:
        segment = segment_at(tick.state[0])

        def solve() -> NDArray[np.float64] | None:
            found = mpc.solve(tick.state, path, tick.risk, tick.guess, segment, tick.last)
            return None if found.failed else found.plan.controls

        return solve

    return prepare


def in_turn(mpc: MPC, solver: Solver, afresh: Solver) -> Solver:
    """Return a solver that also tries another start every fifth tick.

    Args:
        mpc: whose costs count.
        solver: goes on from the last plan.
        afresh: another instance of it, so that what one keeps from tick to tick does not spoil
            the other's. Its starts are pursuits of each of some ways, in turn.
    """
    path, ways = straight(), [straight(aside) for aside in ASIDE]
    ticks = 0

    def prepare(tick: Tick) -> Solve:
        nonlocal ticks
        ticks = 0 if tick.is_first else ticks + 1
        solves = [solver(tick)]
        turn, between = divmod(ticks, AFRESH)
        if between == 0:
            guess = pursuit(mpc, ways[turn % len(ways)], tick.state)
            solves.append(afresh(replace(tick, guess=guess, is_first=True)))
        segment = segment_at(tick.state[0])

        def cost(controls: NDArray[np.float64]) -> float:
            plan = mpc.roll(tick.state, controls)
            return mpc.evaluate(plan, path, tick.risk, segment, tick.last)

        def solve() -> NDArray[np.float64] | None:
            found = [controls for each in solves if (controls := each()) is not None]
            return found[0] if len(found) == 1 else min(found, key=cost, default=None)

        return solve

    return prepare


def compare(
    config: MPCConfig, worlds: int, ticks: int, report: Callable[[str], None]
) -> dict[str, dict[str, float]]:
    """Drive each solver's closed loop through the same halls, one after the other.

    Args:
        config: of the problem.
        worlds: halls.
        ticks: of each drive.
        report: told what is being done.

    Returns:
        Name → `beside_ours` of its solves, and cost: of its drives, summed; excess: cost above
        that of the same drive without posts, the mean over halls; dearer_percent: cost above
        that of ours, the mean over halls, and dearer_low, dearer_high: its 95 % interval, halls
        resampled; hits: drives that hit a post; failures: ticks in which no solve succeeded, by
        the solver's own word.
    """
    mpc = MPC(config=config)
    # casadi leaves what it compiles in the working directory, and needs it there.
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        drives = _drives(mpc, worlds, ticks, report)
        # do-mpc's objects know each other, and must be gone before their files are.
        gc.collect()
    compared = beside_ours({name: [t for d in ds for t in d.times] for name, ds in drives.items()})
    reference = np.array([d.cost for d in drives[OURS]])
    # The cost's zero is arbitrary; what the posts add to it is not.
    unhindered = drive(mpc, ours(mpc), None, ticks).cost
    for name, ds in drives.items():
        costs = np.array([d.cost for d in ds])
        dearer = 100 * (costs - reference) / abs(reference)
        interval = grouped_mean(np.arange(worlds), dearer, np.ones(worlds))
        assert interval is not None
        compared[name] |= {
            "cost": float(costs.sum()),
            "excess": float((costs - unhindered).mean()),
            "dearer_percent": interval["value"],
            "dearer_low": interval["low"],
            "dearer_high": interval["high"],
            "hits": float(sum(d.hit for d in ds)),
            "failures": float(sum(d.failures for d in ds)),
        }
    return compared


def makers(mpc: MPC) -> dict[str, Callable[[], Solver]]:
    """Return what makes each solver; those that are compiled take minutes."""

    def fatrop() -> Solver:
        return general(mpc, "fatrop", compiled=True)

    return {
        OURS: lambda: ours(mpc),
        "ours, starts in turn": lambda: in_turn(mpc, ours(mpc), ours(mpc)),
        "IPOPT": lambda: general(mpc, "ipopt", compiled=False),
        "IPOPT, compiled": lambda: general(mpc, "ipopt", compiled=True),
        "fatrop, compiled": fatrop,
        "fatrop, compiled, starts in turn": lambda: in_turn(mpc, fatrop(), fatrop()),
        "do-mpc": lambda: do_mpc(mpc, compiled=False),
        "do-mpc, compiled": lambda: do_mpc(mpc, compiled=True),
        "pytorch_mppi": lambda: mppi(mpc),
    }


def _drives(
    mpc: MPC, worlds: int, ticks: int, report: Callable[[str], None]
) -> dict[str, list[Drive]]:
    """Solver → its drives, hall by hall."""
    solvers = {}
    for name, make in makers(mpc).items():
        report(f"making {name}" + (", which takes minutes" if "compiled" in name else ""))
        solvers[name] = make()
    drives: dict[str, list[Drive]] = {name: [] for name in solvers}
    for seed in range(worlds):
        for name, solver in solvers.items():
            report(f"{name} in hall {seed + 1} of {worlds}")
            drives[name].append(drive(mpc, solver, seed, ticks))
    return drives
