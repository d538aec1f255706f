"""The settings of the paper's simulated set, apart from what takes long to import."""

from __future__ import annotations

from dataclasses import dataclass

from predictor.infra.options import Options, option


@dataclass(frozen=True)
class SimulatedConfig(Options):
    """What the set is made of; its options say what they are. The defaults are the paper's."""

    train: int = option(
        5221, "frames of the four drives to train on, together", "N", low=4, high=10**8
    )
    test: int = option(
        1090, "frames of the two drives to test on, together", "N", low=2, high=10**8
    )
    more: int = option(
        20, "more drives to test on, each in a building of its own", "N", low=0, high=10**5
    )
    validation: int = option(
        5, "drives to tune on, each in a building of its own", "N", low=0, high=10**5
    )
    length: int = option(
        300, "frames of each drive of --more and --validation", "N", low=1, high=10**6
    )
    clutter: float = option(
        0.0, "things that stand on a square metre of floor, such as 0.05", "D", low=0, high=10
    )
    noise: float = option(
        0.0, "standard deviation of the LIDAR's ranges [m], such as 0.03", "M", low=0, high=1
    )
    people: float = option(
        0.0, "people who walk about on a square metre of floor, such as 0.02", "D", low=0, high=10
    )
