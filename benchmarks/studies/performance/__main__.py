"""Time the stages of the control cycle, their growth with sizes, and the throughput of drives.

    python -m benchmarks.studies.performance --drives 4 --peers

Every stage is timed in simulated drives, on one thread and after a warm-up. Then follow the growth
of these times with sensor, map, window and horizon, and the throughput of kernels and of parallel
drives. The machine should be idle otherwise. Interrupted, it continues when the same command is
given again. Measurements by other code, on another machine, with other packages or with other
settings are repeated.
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from foresee.infra.command_line import Command, UsageError
from foresee.infra.options import Options, option

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from benchmarks.studies.performance.measurements import Measurement

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


def measurements(settings: StageSettings, report: Callable[[str], None]) -> list[Measurement]:
    """Return all measurements in their order; their names are group/name.

    Args:
        settings: settings of the run.
        report: function that shows what is being measured.
    """
    # Imported here, so that --help and bad arguments do not wait for slow imports.
    from benchmarks.studies.performance import growth, rates, throughput
    from benchmarks.studies.performance.measurements import Measurement, installed
    from benchmarks.studies.performance.stage_times import closed_loop, spread

    def arm(name: str) -> dict[str, dict[str, float]]:
        times = closed_loop(name, settings.drives, settings.seed)
        return {
            stage: {**spread(taken), "threads": THREADS} for stage, taken in times.items() if taken
        }

    parts: list[Measurement] = []

    def add(name: str, measure: Callable[[], Any], **decisive: Any) -> None:
        parts.append(Measurement(name, decisive, measure))

    seed = settings.seed
    for name in ARMS:
        add(f"arms/{name}", partial(arm, name), drives=settings.drives, seed=seed)
    for name in ("rays", "mapping", "distance", "risk"):
        add(f"measures/{name}", partial(getattr(rates, name), seed), seed=seed)
    for jobs in (1, 2):
        measure = partial(throughput.throughput, settings.episodes, seed, jobs, report)
        add(f"measures/throughput {jobs}", measure, episodes=settings.episodes, seed=seed)
    measure = partial(throughput.memory, settings.memory, seed, report)
    add("measures/memory", measure, drives=settings.memory, seed=seed)
    for axis in growth.AXES:
        add(f"growth/{axis}", partial(growth.grown, axis, seed, report), seed=seed)
    if settings.peers:
        from benchmarks.studies.performance import peers, peers_mpc

        packages = installed(PEERS.values())
        for name in peers.STAGES:
            add(f"peers/{name}", partial(peers.beside, name, seed), seed=seed, packages=packages)
        drives = {"halls": HALLS, "ticks": HALL_TICKS, "packages": packages}
        for name, config in (("mpc", peers_mpc.COST_ONLY), ("mpc, inside", peers_mpc.CONSTRAINED)):
            compare = partial(peers_mpc.compare, config, HALLS, HALL_TICKS, report)
            add(f"peers/{name}", compare, **drives)
    return parts


@dataclass(frozen=True)
class Place(Options):
    """Where the results are written."""

    out: Path = option(
        Path("results/stages"),
        "folder of results.json, growth.png, and finished measurements",
        "DIR",
    )


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


def _run(settings: StageSettings, place: Place) -> None:
    if settings.peers:
        _ask_for(PEERS)
    # Set before numpy is imported, and regardless of the user's environment.
    os.environ.update(dict.fromkeys(LIMITS, str(THREADS)))
    # Imported here, so that --help and bad arguments do not wait for slow imports.
    import torch
    from tqdm import tqdm

    from benchmarks.studies.performance.growth import draw
    from benchmarks.studies.performance.measurements import RUNTIME, KeptMeasurements, installed
    from benchmarks.studies.performance.tables import tables
    from foresee.infra.drawing import save_figures
    from foresee.infra.environment import commit, machine
    from foresee.infra.results_file import write_results

    torch.set_num_threads(THREADS)
    kept = KeptMeasurements(place.out / "parts")
    groups: dict[str, dict[str, Any]] = {"arms": {}, "measures": {}, "growth": {}, "peers": {}}
    with tqdm(unit="part", smoothing=0.0) as bar:
        todo = measurements(settings, lambda what: bar.set_postfix_str(what))
        bar.reset(len(todo))
        for measurement in todo:
            group, name = measurement.name.split("/", 1)
            bar.set_description_str(" ".join(measurement.name.split()))
            measured = kept.find(measurement)
            if measured is None:
                measured = kept.measure(measurement)
            # A measurement of the group "measures" is a dictionary of several measures.
            groups[group] |= measured if group == "measures" else {name: measured}
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
        "stages": groups["arms"]["predicted"],
        "peak_memory_mib": groups["measures"]["worker, peak memory"]["value"],
        **groups,
    }
    write_results(place.out / "results.json", "stages", results)
    save_figures([("growth.png", partial(draw, groups["growth"]))], place.out)
    print(tables(results), "", place.out / "results.json", sep="\n")


main = Command("benchmarks.studies.performance", __doc__, _run)

if __name__ == "__main__":
    sys.exit(main())
