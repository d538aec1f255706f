"""Settings of an evaluation of predictors, and of the replay of a log.

This module imports nothing heavy, since command lines are built from it.
"""

from __future__ import annotations

from dataclasses import dataclass

from foresee.infra.options import Options, option


@dataclass(frozen=True)
class EvaluateConfig(Options):
    """Settings of an evaluation of predictors, with the options of `predictor.evaluate`.

    Attributes:
        every: ticks from one scored prediction to the next.
    """

    world: tuple[str, ...] = option(
        ("corridor", "narrow", "office", "paper", "trap"),
        "buildings to drive in: families of generated buildings, map_server .yaml files, or "
        "folders of such files",
        "W",
    )
    predictors: tuple[str, ...] = option(
        ("none", "extend", "compact"), "predictors by name, module:Class or FILE.safetensors", "P"
    )
    drives: int = option(
        20, "number of drives in each family and in each map", "N", low=1, high=10**6
    )
    seed: int = option(0, "seed of the first drive", "N", low=0, high=2**31)
    window: float = option(
        5.0,
        "side of the square in which the LIDAR is used [m]",
        "M",
        low=1,
        high=100,
    )
    expansion: float = option(
        2.0, "width of the predicted square divided by that of the window", "X", low=1, high=4
    )
    every: int = 10


@dataclass(frozen=True)
class ReplayConfig(Options):
    """Settings of the replay of a robot's log, with the options of `predictor.replay`."""

    predictor: str = option("compact", "predictor: a name, module:Class or FILE.safetensors", "P")
    every: int = option(
        1, "predict, and write the maps, at every N-th scan; all scans are mapped", "N", low=1
    )
    rate: float = option(
        5.0, "predict, and write the maps, at most HZ times a second", "HZ", low=0.01, high=1000
    )
    window: float = option(
        5.0,
        "side of the square around the robot in which a scan changes the map [m]",
        "M",
        low=1,
        high=100,
    )
    expansion: float = option(
        2.0,
        "width of the predicted square divided by that of the window; limited to what the car "
        "can make use of at 4 m/s: 14 m",
        "X",
        low=1,
        high=4,
    )
