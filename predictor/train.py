"""Train a network: `compact`, or one of the paper's.

    foresee train                      compact, and its samples: two hours on 2 cores
    foresee train --arch kinds --start compact     its layer for kinds of building alone; minutes
    foresee train --steps 200 --train 20 --validation 4      a quick trial
    foresee train --start compact --world my_maps/      fine-tuning on your own buildings
    foresee train --arch unet_ff --expansion 1.3 --preset short

Interrupted, it continues when the same command is given again. compact is trained on samples of
simulated walks, which are made first. The maps and logs of --world are split into training and
validation.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from foresee.infra.command_line import Command, Section
from foresee.infra.options import Options, given, jobs_option, option
from predictor.data import SIMULATED
from predictor.data.bag_config import BagConfig
from predictor.networks import ARCHITECTURES
from predictor.networks.image_config import EXPANSIONS
from predictor.recording.settings import DrivesConfig
from predictor.training.checkpoint import TrainError
from predictor.training.image_options import ImageOptions
from predictor.training.settings import (
    PRESETS,
    TUNING,
    TUNING_DRIVES,
    CompactTraining,
)
from predictor.weights import SUFFIX

DRIVES, SCRATCH = DrivesConfig(), CompactTraining()
PAPER, SHORT = PRESETS["paper"].training, PRESETS["short"].training
TRAINED = Path("results/train")
"""Default folder of the results of a training from random weights."""
TUNED = Path("data/fine-tuning"), Path("results/fine-tuning")
"""Default folders of the samples and of the results of a fine-tuning (--start)."""
KINDS = Path("results/kinds")
"""Default folder of the result of --arch kinds."""
ON_SAMPLES = ("compact", "kinds")
"""What is trained on samples of walks and logs: the network, or its layer of kinds."""
WEIGHTS = "compact.safetensors"
"""Name of the file of its weights."""
COMPACT = "compact and kinds alone"
RECORDED = Section(COMPACT, ("simulated_logs", "families", "world", "share"))
"""Fields of `DrivesConfig` that are also options of this command."""


@dataclass(frozen=True)
class TrainSettings(Options):
    """Settings of the training of any network; for None the network's own default is used."""

    arch: str = option(
        "compact", "architecture of the network", choices=(*ON_SAMPLES, *ARCHITECTURES)
    )
    data: Path | None = option(
        None,
        "folder of the training data. For compact and kinds: samples, which are made first if "
        f"they are missing (default: {DRIVES.out}; with --start: {TUNED[0]}). For the paper's "
        f"networks: frames of predictor.dataset or drives (default: {SIMULATED})",
        "DIR",
    )
    out: Path | None = option(
        None,
        f"folder of checkpoint, log, curve and weights (default: {TRAINED}; with --start: "
        f"{TUNED[1]}; kinds: {KINDS}; or results/networks/ARCH-EXPANSION)",
        "DIR",
    )
    batch: int | None = option(
        None,
        f"samples per optimiser step (default: {SCRATCH.batch}; paper: {PAPER.batch}; "
        f"short: {SHORT.batch})",
        "N",
        low=1,
    )
    rate: float | None = option(
        None,
        f"highest learning rate (default: {SCRATCH.rate:g}; with --start: {TUNING.rate:g}; paper: "
        f"{PAPER.rate:g}; short: {SHORT.rate:g})",
        "R",
        low=1e-12,
        high=1,
    )
    seed: int | None = option(
        None,
        f"seed of the first weights and of the order of samples (default: {SCRATCH.seed})",
        "N",
        low=0,
        high=2**63,
    )
    jobs: int = jobs_option()


@dataclass(frozen=True)
class CompactOptions(Options):
    """Options that are valid for compact and its layer of kinds alone."""

    train: int | None = option(
        None,
        "number of drives to train on, with about 50 samples each (default: "
        f"{DRIVES.train}; with --start: {TUNING_DRIVES[0]})",
        "N",
        low=1,
    )
    validation: int | None = option(
        None,
        f"number of drives held out for validation (default: {DRIVES.validation}; with --start: "
        f"{TUNING_DRIVES[1]})",
        "N",
        low=1,
    )
    steps: int | None = option(
        None,
        f"number of optimiser steps (default: {SCRATCH.steps}; with --start: {TUNING.steps})",
        "N",
        low=1,
    )
    start: Path | None = option(
        None,
        f"weights to fine-tune: a file, FILE{SUFFIX}, or the name of a shipped network, such as "
        "compact (default: random weights). Of compact, the scores before and after are printed",
        "WEIGHTS",
    )


@dataclass(frozen=True)
class NetworkOptions(ImageOptions):
    """Options that are valid for the paper's networks alone."""

    expansion: float | None = option(
        None,
        "width of the predicted square divided by the 5 m of the crop; the paper has "
        f"{', '.join(map(str, EXPANSIONS))} (default: {EXPANSIONS[0]})",
        "X",
    )


def _run(
    settings: TrainSettings,
    compact: Annotated[CompactOptions, Section(COMPACT)],
    drives: Annotated[DrivesConfig, RECORDED],
    topics: Annotated[BagConfig, Section(f"bags of --world; {COMPACT}")],
    network: Annotated[NetworkOptions, Section("the paper's networks alone")],
) -> None:
    on_samples = settings.arch in ON_SAMPLES
    if on_samples:
        wrong, owner = network.changed(), "the paper's networks'"
    else:
        wrong, owner = compact.changed() + drives.changed() + topics.changed(), "compact's"
    if wrong:
        raise TrainError(f"{wrong[0]} is {owner}, not {settings.arch}'s")
    if on_samples:
        path = _train_on_samples(settings, compact, replace(drives, topics=topics))
    else:
        path = _train_network(settings, network)
    print(path)


def _train_network(settings: TrainSettings, network: NetworkOptions) -> Path:
    """Train one of the paper's networks, and return the path of its weights."""
    # Imported here, so that --help and bad arguments do not wait for slow imports.
    from predictor.training.image_training import train_images

    arch = settings.arch
    expansion = EXPANSIONS[0] if network.expansion is None else network.expansion
    config, training = network.configured(
        arch, expansion, settings.batch, settings.rate, settings.seed
    )
    out = settings.out or Path("results/networks") / f"{arch}-{expansion:g}"
    return train_images(config, training, settings.data or SIMULATED, out, settings.jobs)


def _train_on_samples(
    settings: TrainSettings, compact: CompactOptions, drives: DrivesConfig
) -> Path:
    """Train compact or its layer of kinds, on samples that are made if they are missing.

    Returns:
        Path of the weights.

    Raises:
        TrainError: if the weights to start from cannot be read, or would be overwritten.
        SamplesError: if the samples cannot be read.
        SplitError: if training and validation share a building.
    """
    # Imported here, so that --help and bad arguments do not wait for slow imports.
    import torch

    from predictor.data.samples import Samples
    from predictor.data.splits import check_apart
    from predictor.networks.compact_net import CompactNet
    from predictor.recording.training_drives import make
    from predictor.training.compact_comparison import table
    from predictor.training.compact_training import CompactTrainer
    from predictor.training.kinds_training import check_start, train_layer
    from predictor.weights import WeightsError, load_weights, weights_path

    is_layer = settings.arch == "kinds"
    if is_layer and compact.start is None:
        raise TrainError("--arch kinds adds a layer to a trained compact: give it as --start")
    schedule = given(
        steps=compact.steps, batch=settings.batch, rate=settings.rate, seed=settings.seed
    )
    if is_layer and schedule:
        raise TrainError(f"--{next(iter(schedule))} does not apply to --arch kinds")
    source, start, learned = None, None, frozenset[str]()
    training = SCRATCH
    out = settings.out or TRAINED
    if compact.start is not None:
        try:
            source = weights_path(compact.start)
            start = load_weights(source, CompactNet)
        except WeightsError as error:
            raise TrainError(f"--start: {error}") from None
        for name in ("worlds", "validation_worlds"):
            if not isinstance(start[1].get(name, []), list):
                raise TrainError(f"--start: {source}: {name} is no list of buildings")
        learned = frozenset(start[1].get("worlds", ()))
        training = replace(TUNING, start=start[1]["fingerprint"])
        out = settings.out or (KINDS if is_layer else TUNED[1])
        count, held_out = TUNING_DRIVES
        drives = replace(drives, out=TUNED[0], train=count, validation=held_out)
        if (out / WEIGHTS).resolve() == source.resolve():
            raise TrainError(f"--out {out} would overwrite the weights of --start: choose another")
    if start is not None and is_layer:
        # Checked now, too, before hours of drives.
        check_start(start[0], out / WEIGHTS)
    if is_layer and not drives.world and len(set(drives.families)) < 2:
        raise TrainError("--families names one family: --arch kinds tells two or more apart")
    numbers = given(out=settings.data, train=compact.train, validation=compact.validation)
    drives = replace(drives, **numbers)
    # Made now, so that an unusable folder is reported before hours of drives.
    out.mkdir(parents=True, exist_ok=True)
    make(drives, settings.jobs, learned)
    torch.set_num_threads(settings.jobs)
    train = Samples.load(drives.out / "train", drives.train)
    validation = Samples.load(drives.out / "validation", drives.validation)
    check_apart({"train": train.worlds, "validation": validation.worlds})
    if start is not None and is_layer:
        return train_layer(*start, train, validation, out / WEIGHTS)
    training = replace(training, **schedule)
    path = CompactTrainer(training, train, validation, out, start).run()
    if source is not None:
        print(table(source, path, validation))
    return path


main = Command("predictor.train", __doc__, _run)

if __name__ == "__main__":
    sys.exit(main())
