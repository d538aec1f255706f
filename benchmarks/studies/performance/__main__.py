"""Time the stages of the control cycle, their growth with sizes, and the throughput of drives.

python -m benchmarks.studies.performance --help
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from foresee.infra.command_line import OneLineParser, UsageError, run_command
from foresee.infra.options import Options, option

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable, Iterable

    from benchmarks.studies.performance.measurements import Measurement

COMMAND = "benchmarks.studies.performance"
ARMS = ("predicted", "known", "oracle")
PEERS = {
    "octomap": "octomap-python",
    "raycast2D": "raycast2D",
    "cv2": "opencv-python-headless",
    "pytorch_mppi": "pytorch-mppi",
}
"""Module that `--peers` needs → package that contains it."""
COMPILER = "gcc"
"""C compiler that casadi calls by default."""
THREADS = 1
"""Number of threads that a library may use while it is measured."""
LIMITS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that limit the threads of libraries, also in processes started here."""
HALLS, HALL_TICKS = 20, 100
"""Number of drives of each solver of the MPC's problem, and their length [ticks]."""


def measurements(args: StageSettings, report: Callable[[str], None]) -> list[Measurement]:
    """Return all measurements in their order; their names are group/name.

    Args:
        args: settings of the run.
        report: function that shows what is being measured.
    """
    from benchmarks.studies.performance import growth, rates, throughput
    from benchmarks.studies.performance.measurements import Measurement, installed
    from benchmarks.studies.performance.stage_times import closed_loop, spread

    def arm(name: str) -> dict[str, dict[str, float]]:
        times = closed_loop(name, args.drives, args.seed)
        return {
            stage: {**spread(taken), "threads": THREADS} for stage, taken in times.items() if taken
        }

    found: list[Measurement] = []

    def add(name: str, measure: Callable[[], Any], **settings: Any) -> None:
        found.append(Measurement(name, settings, measure))

    seed = args.seed
    for name in ARMS:
        add(f"arms/{name}", partial(arm, name), drives=args.drives, seed=seed)
    for name in ("rays", "mapping", "distance", "risk"):
        add(f"measures/{name}", partial(getattr(rates, name), seed), seed=seed)
    for jobs in (1, 2):
        measure = partial(throughput.throughput, args.episodes, seed, jobs, report)
        add(f"measures/throughput {jobs}", measure, episodes=args.episodes, seed=seed)
    measure = partial(throughput.memory, args.memory, seed, report)
    add("measures/memory", measure, drives=args.memory, seed=seed)
    for axis in growth.AXES:
        add(f"growth/{axis}", partial(growth.grown, axis, seed, report), seed=seed)
    if args.peers:
        from benchmarks.studies.performance import peers, peers_mpc

        packages = installed(PEERS.values())
        for name in peers.STAGES:
            add(f"peers/{name}", partial(peers.beside, name, seed), seed=seed, packages=packages)
        settings = {"halls": HALLS, "ticks": HALL_TICKS, "packages": packages}
        for name, config in (("mpc", peers_mpc.COST_ONLY), ("mpc, inside", peers_mpc.CONSTRAINED)):
            compare = partial(peers_mpc.compare, config, HALLS, HALL_TICKS, report)
            add(f"peers/{name}", compare, **settings)
    return found


@dataclass(frozen=True)
class StageSettings(Options):
    """Settings that decide what is measured, except for code and machine."""

    drives: int = option(
        4, "number of drives of each arm in which its stages are timed", "N", low=1, high=10**6
    )
    episodes: int = option(
        6,
        "number of tasks for measuring the throughput: the default arms drive each with one "
        "process, then with two",
        "N",
        low=1,
        high=10**6,
    )
    memory: int = option(
        12,
        "number of drives of one process for measuring its largest memory",
        "N",
        low=6,
        high=10**6,
    )
    seed: int = option(0, "seed of the first drive", "N", low=0, high=2**31)
    peers: bool = option(
        False,
        "also time other libraries for the same tasks, which takes some minutes, mostly for "
        "compiling; needs pip install 'foresee[peers]'",
    )


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 2 for bad arguments, 130 if interrupted."""
    parser = OneLineParser(
        prog="benchmarks.studies.performance",
        description="Time every stage of the control cycle in simulated drives, on one thread and "
        "after a warm-up; the growth of these times with sensor, map, window and horizon; and the "
        "throughput of kernels and of parallel drives. The machine should be idle otherwise. "
        "Interrupted, it continues when the same command is given again. Measurements by other "
        "code, on another machine, with other packages or with other settings are repeated.",
    )
    StageSettings.add_to(parser)
    what = "folder of results.json, growth.png, and finished measurements"
    parser.add_out("results/stages", what, "DIR")
    return run_command(COMMAND, lambda: _run(parser.parse_args(argv)))


def _ask_for(modules: Iterable[str]) -> None:
    """Check, before anything is measured, that modules and the C compiler are installed.

    Raises:
        UsageError: if one is missing.
    """
    import shutil
    from importlib.util import find_spec

    missing = [name for name in modules if find_spec(name) is None]
    if missing:
        raise UsageError(f"--peers needs {', '.join(missing)}: pip install 'foresee[peers]'")
    if shutil.which(COMPILER) is None:
        raise UsageError(f"--peers needs {COMPILER}, to compile the problems of other solvers")


def _run(args: Namespace) -> None:
    settings = StageSettings.of(args)
    if settings.peers:
        _ask_for(PEERS)
    # Set before numpy is imported, and regardless of the user's environment.
    os.environ.update(dict.fromkeys(LIMITS, str(THREADS)))
    import torch
    from tqdm import tqdm

    from benchmarks.studies.performance.growth import draw
    from benchmarks.studies.performance.measurements import RUNTIME, KeptMeasurements, installed
    from benchmarks.studies.performance.tables import tables
    from foresee.infra.environment import commit, machine
    from foresee.infra.results_file import write_results

    torch.set_num_threads(THREADS)
    kept = KeptMeasurements(args.out / "parts")
    found: dict[str, dict[str, Any]] = {"arms": {}, "measures": {}, "growth": {}, "peers": {}}
    with tqdm(unit="part", smoothing=0.0) as bar:
        todo = measurements(settings, lambda what: bar.set_postfix_str(what))
        bar.reset(len(todo))
        for one in todo:
            group, name = one.name.split("/", 1)
            bar.set_description_str(" ".join(one.name.split()))
            measured = kept.find(one)
            if measured is None:
                measured = kept.measure(one)
            # A measurement of the group "measures" is a dictionary of several measures.
            found[group] |= measured if group == "measures" else {name: measured}
            bar.set_postfix_str("")
            bar.update()
    here = machine()
    here["packages"] |= installed([RUNTIME, *(PEERS.values() if settings.peers else ())])
    results = {
        "machine": here,
        "commit": commit(),
        "threads": THREADS,
        "drives": settings.drives,
        "seed": settings.seed,
        "stages": found["arms"]["predicted"],
        "peak_memory_mib": found["measures"]["worker, peak memory"]["value"],
        **found,
    }
    write_results(args.out / "results.json", "stages", results)
    draw(found["growth"]).savefig(args.out / "growth.png")
    print(tables(results), "", args.out / "results.json", sep="\n")


if __name__ == "__main__":
    sys.exit(main())
