"""Train the network of frontiers, which tells which openings lead on to the goal.

    foresee train-frontiers                        half an hour on 2 cores
    foresee train-frontiers --train 60 --validation 12 --steps 100 --out results/trial

The samples are made first, by explorations of generated buildings in
`predictor.recording.exploration`. Interrupted, it continues when the same command is given again.
"""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass
from pathlib import Path

from foresee.infra.command_line import Command
from foresee.infra.options import Options, jobs_option, option
from predictor.recording.settings import FrontiersConfig
from predictor.training.settings import FrontierTraining

SAMPLES = ("train", "validation", "families")
"""Settings of the samples that decide the weights as well."""


@dataclass(frozen=True)
class Place(Options):
    """Options of where the training runs and is saved; none of them changes a result."""

    jobs: int = jobs_option()
    out: Path = option(
        Path("results/frontiers"), "folder of checkpoint, log, curve and weights", "DIR"
    )


def _run(config: FrontiersConfig, training: FrontierTraining, place: Place) -> None:
    # Imported here, so that --help does not wait for slow imports.
    import torch

    from foresee.infra.resumable import ResumableFolder
    from predictor.data.frontier_samples import FrontierSamples
    from predictor.data.splits import check_apart
    from predictor.networks.frontier_net import FrontierNet
    from predictor.recording.exploration import make
    from predictor.training.frontier_training import FrontierTrainer, scores
    from predictor.weights import load_weights

    settings = asdict(training) | {name: getattr(config, name) for name in SAMPLES}
    # Before the explorations, so that an unusable folder is reported before they are made.
    with ResumableFolder(place.out, settings, exclusive=True):
        make(config, place.jobs)
        torch.set_num_threads(place.jobs)
        train = FrontierSamples.load(config.data / "train", config.train)
        validation = FrontierSamples.load(config.data / "validation", config.validation)
        check_apart({"train": train.worlds, "validation": validation.worlds})
        path = FrontierTrainer(training, train, validation, place.out).run()
    print(scores(load_weights(path, FrontierNet)[0], validation))
    print(path)


main = Command("predictor.train_frontiers", __doc__, _run)

if __name__ == "__main__":
    sys.exit(main())
