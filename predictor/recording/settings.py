"""Settings of recorded drives: for training samples, and for the paper's simulated set.

This module imports nothing heavy, since command lines are built from it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from foresee.infra.options import Options, option
from foresee.mapping.family_names import FAMILIES
from predictor.data import LOG_FORMATS
from predictor.data.bag_config import BagConfig

LEARNED = (
    "corridor",
    "narrow",
    "office",
    "paper",
    "floor_plan",
    "floor_plan",
    "as_built",
    "as_built",
)
"""Families of generated buildings to train on by default. A family that is listed twice gets two
shares of the drives. The other families are held out: no network is trained on them."""
PER_SPLIT = 1_000
"""Number of seeds of buildings for each split of the paper's simulated set."""


@dataclass(frozen=True)
class DrivesConfig(Options):
    """Settings of a set of training samples, with the options of `predictor.drives`.

    Attributes:
        longest: distance after which a walk ends [m], to have more buildings instead.
        views: number of replays of each walk with other LIDARs.
        every: scans from one sample to the next.
        topics: topics of the bags among `world`; None: the only ones.
    """

    out: Path = option(Path("data/drives"), "folder of the samples", "DIR")
    train: int = option(
        2000, "number of drives to train on, with about 50 samples each", "N", low=1, high=1_000_000
    )
    validation: int = option(
        160, "number of drives held out for validation", "N", low=1, high=180_000
    )
    longest: float = 80.0
    views: int = 2
    every: int = 5
    simulated_logs: float = option(
        0.0,
        "share of the drives in generated buildings that are logs of a simulated robot, with a "
        "LIDAR of 180°, scans up to a metre apart, people, and the map of all scans as truth",
        "S",
        low=0,
        high=1,
    )
    families: tuple[str, ...] = option(
        LEARNED,
        "families of the generated buildings, one drive each in turn",
        "F",
        choices=FAMILIES,
    )
    world: tuple[str, ...] = option(
        (),
        "your own buildings: map_server .yaml files, logs of robots, or folders of such files. A "
        f"quarter of the buildings is held out for validation. Logs are {LOG_FORMATS}",
        "W",
    )
    share: float = option(
        0.5,
        "share of the drives in the buildings of --world; the rest are in generated buildings",
        "S",
        low=0,
        high=1,
    )
    topics: BagConfig | None = None


@dataclass(frozen=True)
class FrontiersConfig(Options):
    """Settings of the samples of frontiers, with the options of `predictor.train_frontiers`."""

    data: Path = option(Path("data/frontiers"), "folder of the samples", "DIR")
    train: int = option(
        900,
        "number of buildings to train on, with about 150 samples each",
        "N",
        low=1,
        high=100_000,
    )
    validation: int = option(
        90, "number of buildings held out for validation", "N", low=1, high=10_000
    )
    families: tuple[str, ...] = option(
        LEARNED, "families of the buildings, one each in turn", "F", choices=FAMILIES
    )


@dataclass(frozen=True)
class SimulatedConfig(Options):
    """Settings of the paper's simulated set, with the options of `predictor.dataset`.

    By default, the set is like that of the paper.
    """

    train: int = option(
        5221, "number of frames of the four training drives together", "N", low=4, high=10**8
    )
    test: int = option(
        1090, "number of frames of the two test drives together", "N", low=2, high=10**8
    )
    more: int = option(
        20,
        "number of further test drives, each in a building of its own",
        "N",
        low=0,
        high=PER_SPLIT,
    )
    validation: int = option(
        5, "number of validation drives, each in a building of its own", "N", low=0, high=PER_SPLIT
    )
    length: int = option(
        300, "number of frames of each drive of --more and --validation", "N", low=1, high=10**6
    )
    clutter: float = option(
        0.0, "objects per square metre of floor, such as 0.05", "D", low=0, high=10
    )
    noise: float = option(
        0.0, "standard deviation of the LIDAR's ranges [m], such as 0.03", "M", low=0, high=1
    )
    people: float = option(
        0.0, "walking people per square metre of floor, such as 0.02", "D", low=0, high=10
    )
