"""Train the paper's four networks (three and a perceptron as baseline) at five expansions each.

    foresee study --preset short        all 20, in about two hours on 2 cores
    foresee study                       as in the paper: months without a GPU
    foresee study --sigma 0.02 --epochs 3 --batch 8 --rate 4e-4 --bf16 --jobs 15    minutes on a GPU

The most important trainings come first, so that a study can be stopped at any time. Interrupted, it
continues when the same command is given again: finished trainings are skipped, interrupted ones are
resumed. OUT/status.txt lists how each training ended. Exit status: 1 if a training failed.
"""

from __future__ import annotations

import math
import os
import sys
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from foresee.infra.command_line import Command
from foresee.infra.options import Options, option
from predictor.data import SIMULATED
from predictor.networks import PAPER, PROPOSED
from predictor.networks.image_config import EXPANSIONS
from predictor.training.image_options import ImageOptions

FIRST = (1.1, 1.3, 2.0)
"""Most important expansions, which are trained first."""
OTHERS = tuple(x for x in EXPANSIONS if x not in FIRST)
ORDER = (*product(PROPOSED, FIRST), *product(PROPOSED, OTHERS), *product(("mlp",), EXPANSIONS))
"""All trainings, the most important first."""


@dataclass(frozen=True)
class StudySettings(Options):
    """Which networks are trained, on what data, and where."""

    data: Path = option(SIMULATED, "folder of frames that predictor.dataset has made", "DIR")
    out: Path | None = option(
        None,
        "folder of results, with a folder for each training: checkpoint, log, curve, weights "
        "(default: results/study-PRESET)",
        "DIR",
    )
    archs: tuple[str, ...] = option(
        PAPER,
        f"architectures to train, of {', '.join(PAPER)} (default: all)",
        "A",
        choices=PAPER,
    )
    expansions: tuple[float, ...] = option(
        EXPANSIONS,
        "width of the predicted square divided by the 5 m of the crop, of "
        f"{', '.join(map(str, EXPANSIONS))} (default: all)",
        "X",
        choices=EXPANSIONS,
    )
    jobs: int | None = option(
        None,
        "number of trainings at a time, with one thread each (default: one for each core; 1 "
        "with a GPU)",
        "N",
        low=1,
        high=10_000,
    )
    minutes: float = option(
        math.inf,
        "stop after this many minutes; the same command continues (default: no limit)",
        "M",
        low=1e-3,
    )
    batch: int | None = option(None, "frames per optimiser step (default: the preset's)", "N")
    rate: float | None = option(None, "learning rate (default: the preset's)", "R")
    seed: int | None = option(
        None, "seed of the first weights and of the frames' order (default: 0)", "N"
    )


def _run(settings: StudySettings, images: ImageOptions) -> int:
    # Imported here, so that --help and bad arguments do not wait for slow imports.
    from predictor.training.image_training import load_frames
    from predictor.training.parallel_trainings import Study, Training

    out = settings.out or Path("results") / f"study-{images.preset or 'paper'}"
    train, validation = load_frames(settings.data)
    digests = train.digest, validation.digest
    optimiser = settings.batch, settings.rate, settings.seed
    trainings = [
        Training(
            *images.configured(arch, x, *optimiser),
            settings.data,
            digests,
            out / f"{arch}-{x:.1f}",
        )
        for arch, x in ORDER
        if arch in settings.archs and x in settings.expansions
    ]
    # Free their memory for the trainings.
    del train, validation
    study = Study(trainings, out)
    study.train(settings.jobs or _at_a_time(), settings.minutes)
    print(study.table())
    return 1 if study.failures() else 0


def _at_a_time() -> int:
    import torch

    return 1 if torch.cuda.is_available() else os.cpu_count() or 1


main = Command("predictor.study", __doc__, _run)

if __name__ == "__main__":
    sys.exit(main())
