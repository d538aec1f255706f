"""Train the network of frontiers, which tells which openings lead on to the goal.

    python -m predictor.train_frontiers                        half an hour on 2 cores
    python -m predictor.train_frontiers --train 60 --validation 12 --steps 100 --out results/trial

The samples are made first, by explorations of generated buildings in
`predictor.recording.exploration`. The same command resumes a training that was interrupted.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import asdict

from foresee.infra.command_line import OneLineParser, run_command
from predictor.recording.settings import FrontiersConfig
from predictor.training.frontier_config import FrontierTraining

SAMPLES = ("train", "validation", "families")
"""Settings of the samples that decide the weights as well."""


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 2 for bad arguments or input, 130 if interrupted."""
    parser = OneLineParser(
        prog="predictor.train_frontiers",
        description="Train the network that tells which frontiers lead on to the goal, on "
        "explorations of generated buildings, which are made first. Interrupted, it continues "
        "when the same command is given again.",
    )
    FrontiersConfig.add_to(parser)
    FrontierTraining.add_to(parser)
    parser.add_jobs()
    parser.add_out("results/frontiers", "folder of checkpoint, log, curve and weights", "DIR")
    return run_command("predictor.train_frontiers", lambda: _run(parser.parse_args(argv)))


def _run(args: argparse.Namespace) -> None:
    from foresee.infra.resumable import ResumableFolder

    config, training = FrontiersConfig.of(args), FrontierTraining.of(args)
    told = asdict(training) | {name: getattr(config, name) for name in SAMPLES}
    # Before the explorations, so that an unusable folder is reported before they are made.
    with ResumableFolder(args.out, told, exclusive=True):
        _train(config, training, args)


def _train(config: FrontiersConfig, training: FrontierTraining, args: argparse.Namespace) -> None:
    import torch

    from predictor.data.frontier_samples import FrontierSamples
    from predictor.data.splits import check_apart
    from predictor.networks.frontier_net import FrontierNet
    from predictor.recording.exploration import make
    from predictor.training.frontier_training import FrontierTrainer, scores
    from predictor.weights import load_weights

    make(config, args.jobs)
    torch.set_num_threads(args.jobs)
    train, validation = (
        FrontierSamples.load(config.data / split, count)
        for split, count in (("train", config.train), ("validation", config.validation))
    )
    check_apart({"train": train.worlds, "validation": validation.worlds})
    path = FrontierTrainer(training, train, validation, args.out).run()
    print(scores(load_weights(path, FrontierNet)[0], validation))
    print(path)


if __name__ == "__main__":
    sys.exit(main())
