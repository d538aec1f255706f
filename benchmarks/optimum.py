"""The physical limit: time-optimal drives of the car, with the whole map known.

python -m benchmarks.optimum --help

They are found without the project's planner, so that it can be measured against them: T_bound is a
lower bound of the best time, T_opt an upper one, for it is driven.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.runs.drive_file import DriveFile
from benchmarks.runs.optima import KIND, table
from benchmarks.runs.settings import FAMILIES, Settings
from predictor.infra.command_line import OneLineParser, UsageError, run_command
from predictor.infra.workers import LostError, finished

if TYPE_CHECKING:
    from benchmarks.optimal.minimum_time import Drive, MinimumTime
    from sim.car import CarConfig
    from sim.task import Task

TICK, FINE = 0.1, 0.05
"""Ticks in which drives are looked for, and in which the best is looked at again, about [s]."""
GENTLE = 0.4
"""Share of the car's limits that guesses use where those at its limits lead nowhere."""
ITERATIONS = 150
"""Of the solver from one guess, at most; twice that from a gentle one."""


def quickest(task: Task, car: CarConfig, goal_radius: float) -> tuple[Drive | None, int]:
    """The quickest drive found for a task, if any, and from how many guesses it was looked for.

    Args:
        task: world, start and goal.
        car: limits and body.
        goal_radius: how near the goal a drive ends [m].
    """
    import numpy as np

    from benchmarks.optimal.first_guesses import timed, ways
    from benchmarks.optimal.minimum_time import AROUND, MinimumTime

    known = list(ways(task, car, goal_radius))
    if not known:
        return None, 0
    points = np.vstack([task.start[:2], task.goal, *(way for _, way in known)])
    box = np.stack([points.min(axis=0) - AROUND, points.max(axis=0) + AROUND])
    problem, tried = MinimumTime(task, car, goal_radius, box), 0
    for share, iterations in ((1.0, ITERATIONS), (GENTLE, 2 * ITERATIONS)):
        guesses = [timed(name, way, task.start[2], car, TICK, share) for name, way in known]
        drives = [problem.solve(guess, iterations) for guess in guesses]
        tried += len(guesses)
        valid = [drive for drive in drives if drive.valid]
        if valid:
            best = min(valid, key=lambda drive: drive.time)
            return _finer(problem, best), tried
    return None, tried


def _finer(problem: MinimumTime, drive: Drive) -> Drive:
    """The same drive in finer ticks, where that is quicker."""
    # An even number, so that every other state can be kept.
    fine = problem.solve(drive.resampled(2 * math.ceil(drive.time / FINE / 2)), ITERATIONS, 1e-3)
    return fine if fine.valid and fine.time < drive.time else drive


def optimum(settings: Settings, index: int) -> dict[str, Any]:
    """What the file holds of an episode.

    Raises:
        NoTaskError: if the world has no drive of the length wanted.
    """
    from benchmarks.optimal.shortest_way import NoWayError, shortest_way, time_bound, way_length
    from benchmarks.runs.drive import task_of
    from predictor.infra.environment import commit
    from sim.car import CarConfig
    from sim.episode import EpisodeConfig

    started = time.perf_counter()
    task, car, radius = (
        task_of(settings, index),
        CarConfig(settings.v_max),
        EpisodeConfig().goal_radius,
    )
    shortest = bound = None
    try:
        way = shortest_way(task.world, task.start[:2], task.goal, car.body.half_width)
        shortest = round(way_length(way), 4)
        bound = round(time_bound(shortest, car, radius), 4)
    except NoWayError:
        # Of a gap that only the body's long side shows to be wide enough.
        pass
    drive, tried = quickest(task, car, radius)
    result = {
        "index": index,
        "world": task.world.name,
        "seed": task.seed,
        "start": [float(v) for v in task.start],
        "goal": [float(v) for v in task.goal],
        "t_opt": None,
        "t_bound": bound,
        "shortest": shortest,
        "guesses": tried,
        "commit": commit(),
    }
    if drive is not None:
        stride = 2 if len(drive.controls) % 2 == 0 else 1
        result |= {
            "t_opt": round(drive.time, 4),
            "guess": drive.name,
            "status": drive.status,
            "dt": round(drive.dt, 6),
            "every": stride,
            "states": [[round(float(v), 3) for v in state] for state in drive.states[::stride]],
        }
    return result | {"wall": round(time.perf_counter() - started, 2)}


def attempt(settings: Settings, index: int) -> dict[str, Any] | str:
    """As `optimum`, or a line why the episode has no drive."""
    from sim.task import NoTaskError

    try:
        return optimum(settings, index)
    except NoTaskError as error:
        return str(error)


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 2 for bad arguments or input, 130 if interrupted."""
    return run_command("benchmarks.optimum", lambda: _run(*_parsed(argv)))


def _parsed(argv: list[str] | None) -> tuple[Settings, Path, int]:
    default = Settings()
    parser = OneLineParser(
        prog="benchmarks.optimum",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
        description="Find the car's quickest drives with the whole map known, on the tasks of "
        "benchmarks.corridor, and write them to a file. Interrupted runs go on from where they "
        "were: give the same command again.",
    )
    add = parser.add_argument
    add("--world", nargs="+", default=list(default.world), metavar="W",
        help=f"family of generated worlds ({', '.join(FAMILIES)}), map_server .yaml, or folder of "
        "them; several are taken in turn")  # fmt: skip
    add("--episodes", type=int, default=default.episodes, metavar="N", help="tasks")
    add("--seed", type=int, default=default.seed, metavar="N", help="of the first task")
    add("--v-max", type=float, default=default.v_max, metavar="V", help="top speed [m/s]")
    parser.add_jobs()
    add("--out", type=Path, default=Path("results/optimum.json"), metavar="FILE",
        help="where the drives go")  # fmt: skip
    args = parser.parse_args(argv)
    settings = Settings(
        world=tuple(args.world), episodes=args.episodes, seed=args.seed, v_max=args.v_max
    )
    return settings, args.out, args.jobs


def _run(settings: Settings, out: Path, jobs: int) -> int:
    from tqdm import tqdm

    from benchmarks.runs.drive import check_maps
    from sim.car import CarConfig
    from sim.episode import EpisodeConfig

    check_maps(settings.world)
    car = dataclasses.asdict(CarConfig(v_max=settings.v_max))
    wanted = {"world": list(settings.world), "episodes": settings.episodes, "seed": settings.seed}
    wanted |= car | {"goal_radius": EpisodeConfig().goal_radius}
    store = DriveFile(out, KIND, wanted, grows="episodes")
    todo = [index for index in range(settings.episodes) if index not in store.drives]
    notes = []
    with tqdm(total=settings.episodes, initial=settings.episodes - len(todo), unit="drive") as bar:
        try:
            for index, found in finished(partial(attempt, settings), todo, jobs):
                if isinstance(found, str):
                    notes.append(f"episode {index} left out: {found}")
                else:
                    store.add(found)
                    took = "no drive found" if found["t_opt"] is None else f"{found['t_opt']:.2f} s"
                    bar.set_postfix_str(f"{found['world']} {took}")
                bar.update()
        except LostError as error:
            raise UsageError(f"{error}; the same command tries again") from None
    drives = [store.drives[i] for i in sorted(store.drives) if i < settings.episodes]
    notes += [
        f"episode {d['index']}, {d['world']}: no drive found" for d in drives if d["t_opt"] is None
    ]
    print(*notes, "", table({"drives": drives}), "", out, sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
