"""Make the data sets of the prediction study: the paper's simulated one, and those of real logs.

    python -m predictor.dataset                                    the paper's, and more test drives
    python -m predictor.dataset --log intel.log.gz aces.log.gz             of a robot's own journeys

docs/datasets.md says what is in them; `predictor.data.frames.Frames` reads them.
"""

from __future__ import annotations

import os
import sys
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from predictor.data.bags import BagConfig
    from predictor.data.simulated import SimulatedConfig

RANGES = {
    "train": (4, 10**8),
    "test": (2, 10**8),
    "more": (0, 10**5),
    "validation": (0, 10**5),
    "length": (1, 10**6),
    "clutter": (0, 10),
    "noise": (0, 1),
    "people": (0, 10),
    "jobs": (1, 10**4),
}
"""Between what the command line's numbers must lie: at least a frame a drive."""
SIMULATED, PHYSICAL = Path("data/simulated"), Path("data/physical")


def make_simulated(folder: Path, config: SimulatedConfig, jobs: int) -> None:
    """Make all that is missing of the simulated set, with a progress bar.

    Args:
        folder: of the set.
        config: what is in it.
        jobs: processes.

    Raises:
        FramesError: if the folder holds another set.
        DriveError: if a drive cannot be made.
    """
    from tqdm import tqdm

    from predictor.data.frame_set import FrameSet
    from predictor.data.simulated import check_apart, drives_of, make_drive, settings_of
    from predictor.infra.workers import finished

    drives = {drive.name: drive for drive in drives_of(config)}
    frames = FrameSet(folder, "simulated", settings_of(config), list(drives))
    # The longest first, so that no process is left alone with one at the end.
    todo = sorted((drives[name] for name in frames.missing), key=lambda drive: -drive.count)
    total = sum(drive.count for drive in drives.values())
    there = total - sum(drive.count for drive in todo)
    with tqdm(total=total, initial=there, unit="frame") as bar:
        bar.set_postfix_str(f"{len(frames.done)} of {len(drives)} drives")
        for drive, facts in finished(partial(make_drive, folder, config), todo, jobs):
            frames.add(drive.name, facts)
            bar.set_postfix_str(f"{len(frames.done)} of {len(drives)} drives")
            bar.update(drive.count)
    check_apart(list(frames.done.values()))


def make_physical(folder: Path, paths: list[Path], config: BagConfig, jobs: int) -> None:
    """Make all that is missing of a set of logs, with a progress bar, and say what was skipped.

    The set is of these logs: of one that is not named any more the file stays, but is not in it.

    Args:
        folder: of the set.
        paths: of the logs: CARMEN, or bags of ROS 1 or 2.
        config: which topics of a bag.
        jobs: processes.

    Raises:
        FramesError: if the folder holds another set.
        LogError: if a log cannot be read.
    """
    from tqdm import tqdm

    from predictor.data.frame_set import FrameSet
    from predictor.data.survey import make_log, settings_of, site_of, sources_of
    from predictor.infra.workers import finished

    sites = {site_of(path): path for path in paths}
    frames = FrameSet(folder, "physical", settings_of(config), list(sites), sources_of(paths))
    todo = [sites[name] for name in frames.missing]
    with tqdm(total=len(sites), initial=len(sites) - len(todo), unit="log") as bar:
        for path, facts in finished(partial(make_log, folder, config), todo, jobs):
            frames.add(site_of(path), facts)
            passed = "".join(f"; skipped: {n} {what}" for what, n in facts["skipped"].items() if n)
            bar.write(f"{facts['map']}: {facts['count']} frames{passed}", file=sys.stderr)
            bar.update()


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 2 for bad arguments or input, 130 if interrupted."""
    from predictor.data.frames import FramesError
    from predictor.data.laser_log import LogError
    from predictor.data.simulated import DriveError
    from predictor.infra.workers import WorkersError

    args = _parsed(argv)
    for name, (low, high) in RANGES.items():
        if not low <= getattr(args, name) <= high:
            print(f"predictor.dataset: --{name} must lie between {low} and {high}", file=sys.stderr)
            return 2
    for path in args.log or ():
        if not path.name:
            print(f"predictor.dataset: --log: {str(path)!r} is no log", file=sys.stderr)
            return 2
    try:
        print(_run(args))
    except KeyboardInterrupt:
        print("interrupted; the same command goes on from here", file=sys.stderr)
        return 130
    except (FramesError, LogError, DriveError, OSError, WorkersError) as error:
        print(f"predictor.dataset: {error}", file=sys.stderr)
        return 2
    return 0


def _parsed(argv: list[str] | None) -> Any:
    from predictor.data.simulated import SimulatedConfig
    from predictor.infra.command_line import OneLineParser

    default = SimulatedConfig()
    parser = OneLineParser(
        prog="predictor.dataset",
        description="Make the data of Katyal et al. 2018: what a car's LIDAR has seen, tick by "
        "tick, and what was true around it. Without --log by simulation, six drives in two "
        "buildings and more in others; with --log from real robots' logs. Interrupted, it goes on "
        "where it was: give the same command.",
    )
    add = parser.add_argument
    add("--out", type=Path, metavar="DIR", help="folder of the set (default: "
        f"{SIMULATED}, with --log {PHYSICAL})")  # fmt: skip
    add("--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes (default: "
        "%(default)s)")  # fmt: skip
    simulated = parser.add_argument_group("simulated")
    add = simulated.add_argument
    add("--train", type=int, default=default.train, metavar="N", help="frames of the four drives "
        "to train on, together (default: %(default)s, the paper's)")  # fmt: skip
    add("--test", type=int, default=default.test, metavar="N", help="frames of the two drives to "
        "test on, together (default: %(default)s, the paper's)")  # fmt: skip
    add("--more", type=int, default=default.more, metavar="N", help="more drives to test on, each "
        "in a building of its own (default: %(default)s)")  # fmt: skip
    add("--validation", type=int, default=default.validation, metavar="N", help="drives to tune "
        "on, each in a building of its own (default: %(default)s)")  # fmt: skip
    add("--length", type=int, default=default.length, metavar="N", help="frames of each of these "
        "(default: %(default)s)")  # fmt: skip
    add("--clutter", type=float, default=default.clutter, metavar="D", help="things that stand on "
        "a square metre of floor, such as 0.05 (default: %(default)g, the paper's)")  # fmt: skip
    add("--noise", type=float, default=default.noise, metavar="M", help="standard deviation of the "
        "LIDAR's ranges [m], such as 0.03 (default: %(default)g, the paper's)")  # fmt: skip
    add("--people", type=float, default=default.people, metavar="D", help="who walk about, on a "
        "square metre of floor, such as 0.02 (default: %(default)g, the paper's)")  # fmt: skip
    physical = parser.add_argument_group("physical")
    add = physical.add_argument
    add("--log", nargs="+", type=Path, metavar="PATH", help="logs with corrected poses, or folders "
        "of them: CARMEN (.log, .log.gz), ROS 1 (.bag), ROS 2 (the bag's folder)")  # fmt: skip
    add("--scans", metavar="TOPIC", help="of a bag's LaserScans (default: the only one)")
    add("--poses", metavar="TOPIC", help="of a bag's poses: /tf, PoseStamped, "
        "PoseWithCovarianceStamped or Odometry (default: /tf where it knows the map, else the only "
        "topic of poses)")  # fmt: skip
    add("--map-frame", default="map", metavar="FRAME", help="that /tf is to lead to (default: "
        "%(default)s)")  # fmt: skip
    return parser.parse_args(argv)


def _run(args: Any) -> Path:
    from predictor.data.bags import BagConfig
    from predictor.data.simulated import SimulatedConfig
    from predictor.data.survey import logs_in

    if args.log:
        folder: Path = args.out or PHYSICAL
        topics = BagConfig(args.scans, args.poses, args.map_frame)
        make_physical(folder, logs_in(args.log), topics, args.jobs)
        return folder
    folder = args.out or SIMULATED
    config = SimulatedConfig(
        **{field.name: getattr(args, field.name) for field in fields(SimulatedConfig)}
    )
    make_simulated(folder, config, args.jobs)
    return folder


if __name__ == "__main__":
    sys.exit(main())
