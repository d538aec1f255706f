"""The settings of the paper's simulated set, apart from what takes long to import."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SimulatedConfig:
    """What the set is made of.

    Attributes:
        train: frames of the four drives to train on, together.
        test: frames of the two drives to test on, together.
        more: further drives to test on, each in a building of its own.
        validation: drives to tune on, each in a building of its own.
        length: frames of each of these.
        clutter: things that stand on a square metre of floor [1/m²].
        noise: standard deviation of the LIDAR's ranges [m].
        people: who walk about, on a square metre of floor [1/m²].
    """

    train: int = 5221
    test: int = 1090
    more: int = 20
    validation: int = 5
    length: int = 300
    clutter: float = 0.0
    noise: float = 0.0
    people: float = 0.0
