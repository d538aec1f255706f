"""The settings of `predictor.evaluate`, apart from what takes long to import."""

from __future__ import annotations

from dataclasses import dataclass

from predictor.infra.options import Options, option


@dataclass(frozen=True)
class EvaluateConfig(Options):
    """What is scored, on what; its options say what they are.

    Attributes:
        every: ticks between two predictions.
    """

    world: tuple[str, ...] = option(
        ("corridor", "narrow", "office", "paper", "trap"),
        "families of generated buildings, map_server .yaml files, folders of them",
        "W",
    )
    predictors: tuple[str, ...] = option(
        ("none", "extend", "compact"), "names, module:Class, FILE.safetensors", "P"
    )
    drives: int = option(
        20, "number of drives in each family, and in each map", "N", low=1, high=10**6
    )
    seed: int = option(0, "seed of the first drive", "N", low=0, high=2**31)
    window: float = option(
        5.0, "side of the square in which the LIDAR is used [m]", "M", low=1, high=100
    )
    expansion: float = option(
        2.0, "width of the predicted square over that of the window", "X", low=1, high=4
    )
    every: int = 10
