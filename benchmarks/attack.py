"""The attack: drives with hostile predictors, in all families. No car may collide.

python -m benchmarks.attack --drives 400
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.runs.drive_file import DriveFile
from benchmarks.runs.settings import FAMILIES, VEHICLES, Settings
from predictor.infra.command_line import OneLineParser, UsageError, between, run_command
from predictor.infra.markdown import markdown
from predictor.infra.workers import LostError, finished

COMMAND = "benchmarks.attack"
SEED = 990_000
"""Of the first building: none that a network has learned from."""
RISKS = (0.0, 0.05, 0.2, 0.5, 0.99)
SPEEDS = (2.0, 4.0, 6.0)


def scenario(index: int, seed: int) -> tuple[str, Settings]:
    """The hostile predictor and the settings of a drive."""
    import numpy as np

    from benchmarks.hostile import KINDS

    rng = np.random.default_rng([seed, index])
    # Each kind in each family before any comes again; all else is drawn.
    kind = list(KINDS)[index % len(KINDS)]
    family = FAMILIES[(index // len(KINDS) + index) % len(FAMILIES)]
    settings = Settings(
        world=(family,),
        route=str(rng.choice(("free", "fixed"))),
        episodes=1,
        seed=seed + index,
        arms=("predicted",),
        predictor="none",
        risk=float(rng.choice(RISKS)),
        v_max=float(rng.choice(SPEEDS)),
        vehicle=str(rng.choice(tuple(VEHICLES))),
    )
    return kind, settings


def attacked(seed: int, seconds: float, index: int) -> dict[str, Any]:
    """Drive once with a hostile predictor; what comes out that should not is `error`."""
    import numpy as np

    from benchmarks.hostile import DEADLINE, KINDS, Hostile
    from benchmarks.runs.arms import ARMS
    from benchmarks.runs.drive import car_of, navigator_for, task_of
    from predictor.infra.environment import commit
    from sim import DubinsCar, Lidar, LidarConfig
    from sim.episode import EpisodeConfig, run_episode
    from sim.task import NoTaskError

    kind, settings = scenario(index, seed)
    found: dict[str, Any] = {
        "index": index, "kind": kind, "world": settings.world[0], "seed": settings.seed,
        "route": settings.route, "vehicle": settings.vehicle, "risk": settings.risk,
        "v_max": settings.v_max, "commit": commit(),
    }  # fmt: skip
    try:
        task = task_of(settings, 0)
    except NoTaskError as error:
        return found | {"outcome": "no task", "error": None, "note": str(error)}
    driver = navigator_for(
        settings, ARMS["predicted"], task, Hostile(KINDS[kind]), deadline=DEADLINE
    )
    config = EpisodeConfig(timeout=seconds * settings.v_max / task.path_length)
    rng = np.random.default_rng([task.seed, 2])
    try:
        episode = run_episode(
            task, driver, DubinsCar(car_of(settings)), Lidar(LidarConfig()), config, rng
        )
    except Exception as error:
        # That nothing gets here is what is measured.
        return found | {"outcome": "crashed", "error": f"{type(error).__name__}: {error}"}
    return found | {
        "outcome": str(episode.outcome),
        "error": None,
        "time": round(episode.time, 1),
        "path_length": round(episode.path_length, 2),
        "max_speed": round(episode.max_speed, 2),
        "impact_speed": episode.impact_speed,
        "ticks": len(episode.trace["kept"]),
        "faults": episode.faults,
    }


def table(found: dict[str, Any]) -> str:
    """The drives of each kind of predictor, how many collided or crashed, and what was counted."""
    from benchmarks.hostile import KINDS

    rows = [["predictor", "drives", "collided", "crashed", "mean speed [m/s]", "faults a drive"]]
    drives = [d for d in found["drives"] if d["outcome"] != "no task"]
    for name, mine in [
        *((kind, [d for d in drives if d["kind"] == kind]) for kind in KINDS),
        ("all", drives),
    ]:
        if not mine:
            continue
        whole = [d for d in mine if d["outcome"] != "crashed"]
        seconds = sum(d["time"] for d in whole)
        metres = sum(d["path_length"] for d in whole)
        counted = sum(
            n for d in whole for fault, n in d["faults"].items() if fault.startswith("predictor")
        )
        rows.append([
            name, str(len(mine)),
            *(str(sum(d["outcome"] == outcome for d in mine)) for outcome in
              ("collided", "crashed")),
            f"{metres / seconds:.2f}" if seconds else "–",
            f"{counted / max(1, len(whole)):.0f}",
        ])  # fmt: skip
    return markdown(rows)


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 1 after a collision or a crash, 2 for bad input, 130 if interrupted."""
    parser = OneLineParser(
        prog=COMMAND,
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
        description="Drive with predictors that lie, write into their arguments, come late, raise "
        "and break the contract, at risks from 0 to 0.99, and count collisions and crashes: there "
        "may be none. Interrupted runs go on: give the same command again.",
    )
    add = parser.add_argument
    add("--drives", type=between(1, 10**9), default=100, metavar="N", help="how many")
    add("--seed", type=between(0, 2**31), default=SEED, metavar="N", help="of the first building")
    add("--seconds", type=between(0.1, 1e6), default=20.0, metavar="S",
        help="most that a drive lasts in simulated time")  # fmt: skip
    parser.add_jobs()
    add("--out", type=Path, default=Path("results/attack.json"), metavar="FILE",
        help="where the drives go")  # fmt: skip
    return run_command(COMMAND, lambda: _run(parser.parse_args(argv)))


def _run(args: argparse.Namespace) -> int:
    from tqdm import tqdm

    settings = {"drives": args.drives, "seed": args.seed, "seconds": args.seconds}
    store = DriveFile(args.out, "attack", settings, grows="drives")
    todo = [index for index in range(args.drives) if index not in store.drives]
    with tqdm(total=args.drives, initial=args.drives - len(todo), unit="drive") as bar:
        try:
            work = partial(attacked, args.seed, args.seconds)
            for _, found in finished(work, todo, args.jobs):
                store.add(found)
                bar.set_postfix_str(found["kind"])
                bar.update()
        except LostError as error:
            raise UsageError(f"{error}; the same command tries again") from None
    drives = [store.drives[i] for i in range(args.drives)]
    print(table({"drives": drives}), "", args.out, sep="\n")
    bad = [d for d in drives if d["outcome"] in ("collided", "crashed")]
    for d in bad:
        print(f"drive {d['index']}, {d['kind']}: {d['outcome']} {d['error'] or ''}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
