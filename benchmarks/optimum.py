"""Compute time-optimal drives of the car with the whole map known.

python -m benchmarks.optimum --help

The project's planner is not used, so that it can be compared with these drives. T_bound is a lower
bound of the shortest possible time. T_opt is an upper bound, since the simulated car drives it.
"""

from __future__ import annotations

import dataclasses
import sys
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.runs.drive_file import DriveFile
from benchmarks.runs.settings import Settings
from foresee.infra.command_line import OneLineParser, run_command


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 2 for bad arguments or input, 130 if interrupted."""
    return run_command("benchmarks.optimum", lambda: _run(*_parsed(argv)))


def _parsed(argv: list[str] | None) -> tuple[Settings, Path, int]:
    parser = OneLineParser(
        prog="benchmarks.optimum",
        description="Find the fastest drives of the car with the whole map known, on the tasks of "
        "benchmarks.corridor, and write them to a file. Interrupted, it continues when the same "
        "command is given again.",
    )
    Settings.add_to(parser, "world", "episodes", "seed", "v_max", "braking")
    parser.add_jobs()
    parser.add_out("results/optimum.json", "file of the drives")
    args = parser.parse_args(argv)
    settings = Settings.of(args)
    return settings, args.out, args.jobs


def _run(settings: Settings, out: Path, jobs: int) -> int:
    from benchmarks.runs.time_optimal import KIND, attempt, table
    from foresee.mapping.car_limits import CarLimits
    from sim.buildings import check_maps
    from sim.episode import EpisodeConfig

    check_maps(settings.world)
    car = dataclasses.asdict(CarLimits(v_max=settings.v_max, braking=settings.braking))
    wanted = {"world": list(settings.world), "episodes": settings.episodes, "seed": settings.seed}
    wanted |= car | {"goal_radius": EpisodeConfig().goal_radius}
    store = DriveFile(out, KIND, wanted, grows="episodes")
    skipped = store.fill(partial(attempt, settings), range(settings.episodes), jobs, _about)
    notes = [f"episode {index} left out: {why}" for index, why in skipped.items()]
    drives = store.first(settings.episodes)
    notes += [
        f"episode {d['index']}, {d['world']}: no drive found" for d in drives if d["t_opt"] is None
    ]
    print(*notes, "", table({"drives": drives}), "", out, sep="\n")
    return 0


def _about(drive: dict[str, Any]) -> str:
    """Return building and T_opt of a drive for the progress bar."""
    took = "no drive found" if drive["t_opt"] is None else f"{drive['t_opt']:.2f} s"
    return f"{drive['world']} {took}"


if __name__ == "__main__":
    sys.exit(main())
