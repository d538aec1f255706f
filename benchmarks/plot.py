"""Draw the figures of runs that benchmarks.corridor saved; nothing is driven again.

    foresee plot results/corridor --episode 3 --animate

For each DIR: speed_profile.png (speed over distance, and what limited it), trajectories.png (the
trajectories on the true map, coloured by speed) and moment.png (maps, prediction and plan at one
tick). With --report also report.html (a page with the table, pictures, and replays of the drives)
and episodes.csv (a row for each drive). With --race also race-EPISODE.gif: known, backup and
predicted side by side, with clocks. With --parting also parting.png: what known and another arm
have seen and expect when their ways part. With --animate also drive-EPISODE-ARM.gif: one drive,
with its speed. With --mcap also the drive as a file for Foxglove: its scans and predictions, which
are not saved in full, are made again from the saved states, and compared with what was saved. For
several DIRs also speed_profiles.png: all runs in one speed profile.

With --episode or --arm, the names of the figures tell it, as in moment-3.png: they replace no
others.

Without --out, the figures of a run are written into its DIR, and speed_profiles.png into the first
DIR. With --out, the figures of one run are written into OUT, those of several runs into OUT/NAME,
and speed_profiles.png into OUT.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from foresee.infra.command_line import Command, UsageError
from foresee.infra.options import Options, argument, option


@dataclass(frozen=True)
class PlotSettings(Options):
    """What is drawn, and where the figures are written."""

    runs: tuple[Path, ...] = argument("folder of a saved run", "DIR")
    episode: int | None = option(None, "draw episode K; by default each figure chooses", "K")
    arm: str | None = option(
        None,
        "arm of moment.png, the video and the MCAP file; by default one that uses a prediction",
    )
    out: Path | None = option(None, "folder for the figures", "OUT")
    animate: bool = option(False, "also write the drive as a video, in real time")
    mcap: bool = option(False, "also write the drive as an MCAP file, with a layout, for Foxglove")
    report: bool = option(
        False, "also write report.html, with replays of the drives, and episodes.csv"
    )
    race: bool = option(False, "also write the drives of an episode, side by side, as a video")
    parting: bool = option(
        False, "also draw known and another arm in the moment in which their ways part"
    )
    format: str = option(
        "auto",
        "format of the videos; auto: MP4 if there is ffmpeg, else GIF",
        choices=("auto", "gif", "mp4"),
    )
    stride: int | None = option(
        None,
        "draw every N-th tick in the videos; by default every tick, or as many as give at most 400 "
        "frames, 150 in a race",
        "N",
        low=1,
    )


def _run(settings: PlotSettings) -> None:
    # Imported here, so that --help does not wait for slow imports.
    from benchmarks.runs.saved_run import Run

    runs = [Run.load(directory) for directory in dict.fromkeys(settings.runs)]
    # Imported after loading, so that a bad run is reported without waiting for slow imports.
    from benchmarks.figures.animation import Animation
    from benchmarks.figures.drive_mcap import write_drive
    from benchmarks.figures.file_name import file_name
    from benchmarks.figures.parting import parting
    from benchmarks.figures.race import Race
    from benchmarks.figures.run_figures import draw_run
    from benchmarks.figures.speed_profile import speed_profile
    from benchmarks.figures.video import kind_for, write_video
    from benchmarks.report.report import write_report
    from foresee.infra.drawing import save_figures

    out, episode, arm = settings.out, settings.episode, settings.arm
    if out is not None and len({run.label for run in runs}) < len(runs):
        raise UsageError("--out: the figures of runs of the same name would overwrite each other")
    kind = kind_for(settings.format) if settings.animate or settings.race else ""
    paths: list[Path] = []
    for run in runs:
        folder = run.directory if out is None else out / run.label if len(runs) > 1 else out
        paths += draw_run(run, folder, episode, arm)
        if settings.animate:
            drive = Animation(run, episode, arm, settings.stride)
            paths.append(folder / file_name("drive", kind, drive.index, drive.arm))
            write_video(drive.frame, len(drive), drive.rate, paths[-1])
        if settings.race:
            race = Race(run, episode, settings.stride)
            paths.append(folder / file_name("race", kind, race.index))
            write_video(race.frame, len(race), race.rate, paths[-1])
        if settings.parting:
            name = file_name("parting", "png", episode, arm)
            paths += save_figures([(name, partial(parting, run, episode, arm))], folder)
        if settings.report:
            paths += write_report(run, folder)
        if settings.mcap:
            paths += write_drive(run, folder, episode, arm)
    if len(runs) > 1:
        name = file_name("speed_profiles", "png", episode)
        together = (name, lambda: speed_profile(runs, episode))
        paths += save_figures([together], out or runs[0].directory)
    print(*paths, sep="\n")


main = Command("benchmarks.plot", __doc__, _run, resumes=False)

if __name__ == "__main__":
    sys.exit(main())
