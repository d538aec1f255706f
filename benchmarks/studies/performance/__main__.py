"""Time the stages of the control cycle, and measure the throughput of kernels and of drives.

    python -m benchmarks.studies.performance --drives 4 --peers

Every stage is timed in simulated drives, on one thread and after a warm-up. Then follows the
throughput of kernels and of parallel drives. The machine should be idle otherwise. Interrupted, it
continues when the same command is given again. Measurements by other code, on another machine, with
other packages or with other settings are repeated.
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
    from collections.abc import Callable

    from benchmarks.studies.performance.measurements import Measurement

ARMS = ("predicted", "known", "oracle")
PEER, PEER_PACKAGE = "pytorch_mppi", "pytorch-mppi"
"""Module that `--peers` needs, and the package that contains it."""
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
        "also time other solvers of the MPC's problem, which takes some minutes, mostly for "
        "compiling; needs pip install 'foresee-nav[peers]'",
    )


def measurements(settings: StageSettings, report: Callable[[str], None]) -> list[Measurement]:
    """Return all measurements in their order; their names are group/name.

    Args:
        settings: settings of the run.
        report: function that shows what is being measured.
    """
    # Imported here, so that --help and bad arguments do not wait for slow imports.
    from benchmarks.studies.performance import peers, rates, throughput
    from benchmarks.studies.performance.beside import beside
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
    for name in ("rays", "mapping", "distance", "risk", "asking"):
        add(f"measures/{name}", partial(getattr(rates, name), seed), seed=seed)
    for jobs in (1, 2):
        measure = partial(throughput.throughput, settings.episodes, seed, jobs, report)
        add(f"measures/throughput {jobs}", measure, episodes=settings.episodes, seed=seed)
    measure = partial(beside, settings.drives, seed, report)
    add("measures/beside", measure, drives=settings.drives, seed=seed)
    measure = partial(throughput.memory, settings.memory, seed, report)
    add("measures/memory", measure, drives=settings.memory, seed=seed)
    add("peers/prediction", partial(peers.predictions, seed), seed=seed)
    if settings.peers:
        from benchmarks.studies.performance import peers_mpc

        packages = installed([PEER_PACKAGE])
        drives = {"halls": HALLS, "ticks": HALL_TICKS, "packages": packages}
        for name, config in (("mpc", peers_mpc.COST_ONLY), ("mpc, inside", peers_mpc.CONSTRAINED)):
            compare = partial(peers_mpc.compare, config, HALLS, HALL_TICKS, report)
            add(f"peers/{name}", compare, **drives)
    return parts


@dataclass(frozen=True)
class Place(Options):
    """Where the results are written."""

    out: Path = option(
        Path("results/stages"), "folder of results.json and of finished measurements", "DIR"
    )


def _check_peers() -> None:
    """Check, before anything is measured, that the peer and the C compiler are installed.

    Raises:
        UsageError: if one is missing.
    """
    import shutil
    from importlib.util import find_spec

    if find_spec(PEER) is None:
        raise UsageError(f"--peers needs {PEER}: pip install 'foresee-nav[peers]'")
    if shutil.which(COMPILER) is None:
        raise UsageError(f"--peers needs {COMPILER}, to compile the problems of other solvers")


def _run(settings: StageSettings, place: Place) -> None:
    if settings.peers:
        _check_peers()
    # Set before numpy is imported, and regardless of the user's environment.
    os.environ.update(dict.fromkeys(LIMITS, str(THREADS)))
    # Imported here, so that --help and bad arguments do not wait for slow imports.
    import torch

    from benchmarks.studies.performance.measurements import RUNTIME, installed
    from benchmarks.studies.performance.tables import tables
    from foresee.infra.environment import commit, machine
    from foresee.infra.progress import progress
    from foresee.infra.results_file import write_results
    from foresee.infra.resumable import ResumableFolder

    torch.set_num_threads(THREADS)
    folder = ResumableFolder(place.out / "parts")
    groups: dict[str, dict[str, Any]] = {"arms": {}, "measures": {}, "peers": {}}
    with progress(unit="part", smoothing=0.0) as bar:
        todo = measurements(settings, lambda what: bar.set_postfix_str(what))
        bar.reset(len(todo))
        for measurement in todo:
            group, name = measurement.name.split("/", 1)
            bar.set_description_str(" ".join(measurement.name.split()))
            measured = folder.once(measurement.file, measurement.measure)
            # A measurement of the group "measures" is a dictionary of several measures.
            groups[group] |= measured if group == "measures" else {name: measured}
            bar.set_postfix_str("")
            bar.update()
    here = machine()
    here["packages"] |= installed([RUNTIME, *([PEER_PACKAGE] if settings.peers else [])])
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
    print(tables(results), "", place.out / "results.json", sep="\n")


main = Command("benchmarks.studies.performance", __doc__, _run)

if __name__ == "__main__":
    sys.exit(main())
