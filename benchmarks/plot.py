"""Draw the figures of saved runs again: `python -m benchmarks.plot DIR [DIR ...]`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from foresee.infra.command_line import OneLineParser, UsageError, between, run_command

DESCRIPTION = """\
Draw the figures of runs that benchmarks.corridor saved. Nothing is driven again.

For each DIR: speed_profile.png (speed over distance, and what limited it), trajectories.png (the
trajectories on the true map, coloured by speed) and moment.png (maps, prediction and plan at one
tick). For several DIRs also speed_profiles.png: all runs in one speed profile.
"""
EPILOG = """\
Without --out, the figures of a run are written into its DIR, and speed_profiles.png into the first
DIR. With --out, the figures of one run are written into OUT, those of several runs into OUT/NAME,
and speed_profiles.png into OUT.
Exit status: 0, or 2 if an argument or a run cannot be used.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line, and return its exit status: 2 for bad arguments or input."""
    return run_command("benchmarks.plot", lambda: _run(_parser().parse_args(arguments)))


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(
        prog="python -m benchmarks.plot",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("runs", metavar="DIR", nargs="+", type=Path, help="folder of a saved run")
    parser.add_argument(
        "--episode", metavar="K", type=int, help="draw episode K; by default each figure chooses"
    )
    parser.add_argument(
        "--arm",
        help="arm that moment.png and the video show; by default one that uses a prediction",
    )
    parser.add_argument("--out", metavar="OUT", type=Path, help="folder for the figures")
    parser.add_argument(
        "--animate", action="store_true", help="also write the drive as a video, in real time"
    )
    parser.add_argument(
        "--format",
        choices=("auto", "gif", "mp4"),
        default="auto",
        help="format of the video; auto: MP4 if there is ffmpeg, else GIF",
    )
    parser.add_argument(
        "--stride",
        metavar="N",
        type=between(1, 10**9),
        help="draw every N-th tick in the video; by default every tick, or as many as give at "
        "most 400 frames",
    )
    return parser


def _run(options: argparse.Namespace) -> None:
    from benchmarks.figures.video import kind_for, write_video
    from benchmarks.runs.saved_run import Run

    runs = [Run.load(directory) for directory in dict.fromkeys(options.runs)]
    # Imported after loading, so that a bad run is reported without waiting for slow imports.
    from benchmarks.figures.animation import Animation
    from benchmarks.figures.run_figures import draw_run
    from benchmarks.figures.speed_profile import speed_profile
    from foresee.infra.drawing import save_figures

    labels = [run.label for run in runs]
    if options.out is not None and len(set(labels)) < len(labels):
        raise UsageError("--out: the figures of runs of the same name would overwrite each other")
    kind = kind_for(options.format) if options.animate else ""
    paths: list[Path] = []
    for run in runs:
        out = options.out or run.directory
        if options.out is not None and len(runs) > 1:
            out = options.out / run.label
        paths += draw_run(run, out, options.episode, options.arm)
        if options.animate:
            drive = Animation(run, options.episode, options.arm, options.stride)
            paths.append(out / f"drive-{drive.index}-{drive.arm}.{kind}")
            write_video(drive.frame, len(drive), drive.rate, paths[-1])
    if len(runs) > 1:
        together = ("speed_profiles.png", lambda: speed_profile(runs, options.episode))
        paths += save_figures([together], options.out or runs[0].directory)
    print(*paths, sep="\n")


if __name__ == "__main__":
    sys.exit(main())
