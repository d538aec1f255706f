"""Settings of an evaluation of predictors.

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
