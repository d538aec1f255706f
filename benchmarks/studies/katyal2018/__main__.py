"""Compare predictors on the data sets of the prediction study, simulated and from real logs.

    python -m benchmarks.studies.katyal2018 --predictors extend compact results/study-short

They are compared by the similarity of their images to the truth (SSIM) and by scores of their
probabilities on unobserved cells, at each expansion of the 5 m crop. The values of the paper are
shown beside them. Two baselines are always included: `copy`, the unchanged input, and `grey`, an
image that is all grey. Interrupted, it continues when the same command is given again. Predictors
and expansions can be added to a folder at any time.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from foresee.infra.command_line import Command, Section, UsageError
from foresee.infra.options import Options, jobs_option, option
from predictor.data import PHYSICAL, SIMULATED
from predictor.data.bag_config import BagConfig
from predictor.networks.image_config import EXPANSIONS


@dataclass(frozen=True)
class PredictionSettings(Options):
    """What is compared, on which data, and where the results are written."""

    out: Path = option(
        Path("results/prediction"), "folder of results.json, tables.md and the figures", "DIR"
    )
    data: Path | None = option(
        None,
        "folder of the simulated data set of predictor.dataset, whose splits test and more are "
        f"scored (default: {SIMULATED}, which may be missing if there are logs)",
        "DIR",
    )
    logs: tuple[Path, ...] = option(
        (),
        "folder of a data set of predictor.dataset --log; or logs, or folders of logs, of which a "
        f"data set is made in OUT/physical (default: {PHYSICAL}, if it exists)",
        "PATH",
    )
    predictors: tuple[str, ...] = option(
        ("none", "extend", "compact", "compact-logs", "compact-paper"),
        "none, extend, compact, compact-logs, compact-paper, module:Class, FILE.safetensors; a "
        "folder of predictor.study, whose networks are compared at the expansion that they were "
        "trained for; or fused:FOLDER/ARCH, which combines them. NAME=P renames a predictor. "
        "Figures show the first eight that predict something",
        "P",
    )
    expansions: tuple[float, ...] = option(
        EXPANSIONS,
        "side of the predicted square divided by 5 m, of 1.02, 1.04, … 2.00",
        "X",
        low=1.02,
        high=2.0,
    )
    apart: float = option(
        0.5,
        "least distance along the drive from one scored frame to the next [m]; 0: all frames are "
        "scored",
        "M",
        low=0,
        high=1000,
    )
    jobs: int = jobs_option()

    def __post_init__(self) -> None:
        super().__post_init__()
        for expansion in self.expansions:
            # Squares are an even number of cells wide.
            if abs(50 * expansion - round(50 * expansion)) > 1e-6:
                raise UsageError(f"--expansions: {expansion} is none of 1.02, 1.04, … 2.00")


def _run(
    settings: PredictionSettings, topics: Annotated[BagConfig, Section("bags of --logs")]
) -> None:
    # Imported here, so that --help and bad arguments do not wait for slow imports.
    import torch

    from benchmarks.studies.katyal2018.contestants import contestants
    from benchmarks.studies.katyal2018.cost import measure_costs, published_costs
    from benchmarks.studies.katyal2018.evaluation import Evaluation
    from benchmarks.studies.katyal2018.figures import draw
    from benchmarks.studies.katyal2018.report import report
    from benchmarks.studies.katyal2018.tables import study_tables, summary
    from foresee.infra.atomic_file import write_whole
    from foresee.infra.environment import several_states
    from predictor.data.frames import MANIFEST

    torch.set_num_threads(1)
    settings.out.mkdir(parents=True, exist_ok=True)
    expansions = tuple(sorted({round(expansion, 2) for expansion in settings.expansions}))
    who = contestants(settings.predictors, expansions)
    logs, data = _logs(settings, topics), settings.data
    if data is None and (logs is None or (SIMULATED / MANIFEST).is_file()):
        data = SIMULATED
    evaluation = Evaluation(settings.out, data, logs, expansions, settings.apart, who)
    # Costs are measured first: they need an idle machine, and reveal invalid predictors early.
    costs, published = measure_costs(evaluation), published_costs(evaluation)
    evaluation.run(settings.jobs)
    results = report(evaluation, costs, published)
    write_whole(settings.out / "tables.md", study_tables(results).encode())
    paths = [settings.out / "results.json", settings.out / "tables.md", *draw(evaluation, results)]
    mixed = several_states(results["commits"], "scores")
    print(*filter(None, [summary(results), mixed, "\n".join(map(str, paths))]), sep="\n\n")


def _logs(settings: PredictionSettings, topics: BagConfig) -> Path | None:
    """Return the folder of the physical data set, made here if logs are given; None without one.

    Raises:
        UsageError: if topics are given without bags to read them from.
    """
    from predictor.data.frames import MANIFEST

    logs = list(settings.logs) or [PHYSICAL]
    made = len(logs) == 1 and (logs[0] / MANIFEST).is_file()
    if (made or not settings.logs) and (without := topics.changed()):
        raise UsageError(f"{without[0]} needs bags as --logs")
    if made:
        return logs[0]
    if not settings.logs:
        return None
    # Imported here, because a data set that exists needs neither planner nor simulator.
    from predictor.data.log_files import logs_in
    from predictor.recording.data_sets import make_physical

    folder = settings.out / "physical"
    make_physical(folder, logs_in(logs), topics, settings.jobs)
    return folder


main = Command("benchmarks.studies.katyal2018", __doc__, _run)

if __name__ == "__main__":
    sys.exit(main())
