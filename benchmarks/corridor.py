"""Drive a car through buildings that are unknown to it, with and without a predicted map.

    foresee corridor --world office --episodes 24 --arms known,predicted,oracle

The times and collisions of the arms are compared. Interrupted, it continues when the same command
is given again. Exit status: 0 if all drives were made, whatever their outcomes; 1 if drives are
missing, because processes died or the disk is full.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from benchmarks.runs.settings import HEADINGS, Settings
from foresee.infra.command_line import Command, Section, UsageError
from foresee.infra.errors import LineError
from foresee.infra.options import Options, jobs_option, option
from foresee.infra.workers import LostError, check_scheduler, finished

if TYPE_CHECKING:
    from benchmarks.runs.store import Store
    from benchmarks.runs.trace import Drive


@dataclass(frozen=True)
class Risks(Options):
    """The risks at which arm predicted drives."""

    risk: tuple[float, ...] = option(
        (0.0,),
        "accepted probability of a collision in a drive of arm predicted; several values are "
        "several columns of the table, predicted, predicted 2 %% and so on. 0: collisions are "
        "excluded by construction",
        "RISK",
        low=0,
        high=1,
    )
    calibration: Path | None = option(
        None,
        "calibration.json of benchmarks.calibrate, which gives the level for each --risk; for "
        "the same predictor, planner, car and buildings (default: the one that ships with foresee "
        "for these drives)",
        "FILE",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(set(self.risk)) < len(self.risk):
            raise UsageError("--risk names a number more than once")


WITHOUT_RISK = tuple(field.name for field in fields(Settings) if field.name != "risk")
"""Settings that are options of their own; `Risks` takes the place of the risk of one drive."""


@dataclass(frozen=True)
class Place(Options):
    """Options of where a run is computed and saved; none of them changes a result."""

    jobs: int = jobs_option()
    dask: str | None = option(
        None,
        "address of a Dask scheduler, such as tcp://10.0.0.1:8786, whose workers drive instead of "
        "processes on this machine",
        "ADDRESS",
    )
    baselines: Path | None = option(
        None,
        "folder of an earlier run with another --predictor, --reliance, --risk or --expansion: "
        "drives that would be the same are copied from there (those of known, optimistic and "
        "full; if the expansion is the same, also of backup and known+truth10, 20 and 40; if "
        "expansion and reliance are the same, also of perfect and oracle)",
        "DIR",
    )
    optimum: Path | None = option(
        None,
        "results file of benchmarks.optimum for the same tasks and top speed: adds its least times "
        "T_opt to the results",
        "FILE",
    )
    out: Path = option(
        Path("results/corridor"),
        "folder of results.json, traces.npz, report.html, episodes.csv and the figures",
        "DIR",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.dask is not None:
            check_scheduler(self.dask)


RELIANCE = {"how far it relies on predictions": ("calibration",)}
LARGE = {"large comparisons": ("dask", "baselines", "optimum")}
"""Headings in the help → options below them."""


def _run(
    settings: Annotated[Settings, Section(names=WITHOUT_RISK, below=HEADINGS)],
    risks: Annotated[Risks, Section(below=RELIANCE)],
    place: Annotated[Place, Section(below=LARGE)],
) -> int:
    if place.optimum is not None and settings.vehicle != "dubins":
        raise UsageError("--optimum: its times are those of the dubins car")
    if place.optimum is not None and settings.car is not None:
        raise UsageError("--optimum: its times are those of the default car, not of --car")
    if place.optimum is not None and not settings.draws_tasks:
        raise UsageError("--optimum: its times are those of drawn tasks, not of given ones")
    # Imported here, so that --help and bad arguments do not wait for slow imports.
    from benchmarks.calibration.certificate import arms_at
    from benchmarks.figures.run_figures import draw_all
    from benchmarks.report.report import write_report
    from benchmarks.runs.drive import attempt_arm, run_fingerprint
    from benchmarks.runs.drive_result import DriveResult
    from benchmarks.runs.saved_run import RESULTS, Run
    from benchmarks.runs.store import Store
    from benchmarks.runs.summary_text import in_words, main_table, title
    from benchmarks.runs.tasks import input_hashes, limit_speed, read_rules
    from benchmarks.runs.time_optimal import read_t_opt
    from benchmarks.runs.warm_up import warm_up_if_cold
    from foresee.infra.environment import several_states

    if place.dask is None:
        warm_up_if_cold()
    weights = run_fingerprint(settings)
    maps = input_hashes(settings)
    settings = limit_speed(settings, read_rules(settings))
    arms = arms_at(settings, risks.risk, risks.calibration)
    settings = replace(settings, arms=tuple(arms), uncertified=False)
    levels = {name: chosen.level for name, chosen in arms.items() if chosen.risk > 0}
    t_opt = None if place.optimum is None else read_t_opt(place.optimum, settings, maps)
    out = place.out
    with Store(out, settings, weights, place.baselines, maps, levels) as store:
        for note in store.notes:
            print(f"warning: {note}", file=sys.stderr)
        work = partial(attempt_arm, arms, weights, maps=maps)
        interrupted = _drive_all(store, settings, work, place)
        results = store.pack(t_opt)
    done = results["episodes"]
    if t_opt is not None and done and all(e["t_opt"] is None for e in done):
        print(f"warning: {place.optimum} has no T_opt of these tasks", file=sys.stderr)
    print(f"\n{title(results['settings'])}\n\n{main_table(results['summary'])}\n")
    for index, why in store.skipped.items():
        print(f"episode {index} left out: {why}")
    mixed = several_states((e.get("commit") for e in results["episodes"]), "drives")
    if mixed:
        print(mixed)
    learned = len({e["index"] for e in results["episodes"] if e.get("learned")})
    if learned:
        where = f"the buildings of {learned} episodes"
        print(f"warning: the predictor was trained or validated in {where}")
    if interrupted:
        print(f"\ninterrupted; {out} keeps the finished drives, the same command continues the run")
        return 130
    if results["summary"]:
        print(*draw_all(out), *write_report(Run.load(out), out), sep="\n")
    print(f"{out / RESULTS}; `foresee tables {out / RESULTS}` prints all rows")
    drives = [DriveResult.from_json(drive) for drive in results["episodes"]]
    print(f"\n{in_words(results['summary'], drives)}")
    return 1 if store.lost else 0


def _drive_all(
    store: Store,
    settings: Settings,
    work: Callable[[tuple[int, str]], Drive | str],
    place: Place,
) -> bool:
    """Make the missing drives, with a progress bar; return whether it was interrupted."""
    from foresee.infra.progress import progress

    done = store.done()
    todo = [
        (index, arm)
        for index in range(settings.episodes)
        for arm in settings.arms
        if (index, arm) not in done and index not in store.skipped
    ]
    total = settings.episodes * len(settings.arms)
    with progress(total=total, initial=total - len(todo), unit="drive", smoothing=0.05) as bar:
        try:
            for (index, arm), driven in finished(work, todo, place.jobs, place.dask):
                if isinstance(driven, str):
                    store.skipped[index] = driven
                else:
                    store.add(driven)
                    result = driven.result
                    text = f"{arm} {result.outcome} in {result.time:.1f} s"
                    bar.set_postfix_str(text, refresh=False)
                bar.update()
        except KeyboardInterrupt:
            return True
        except LostError as error:
            store.lost = list(error.items)
            bar.write(f"warning: {error}", file=sys.stderr)
        except LineError as error:
            raise UsageError(f"{error}; what was finished is kept") from None
    return False


main = Command("benchmarks.corridor", __doc__, _run)

if __name__ == "__main__":
    sys.exit(main())
