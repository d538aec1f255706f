"""The settings of `predictor.evaluate`, apart from what takes long to import."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class EvaluateConfig:
    """What is scored, on what.

    Attributes:
        world: families of generated worlds, map_server files, folders of them.
        predictors: by name, `package.module:Class`, or path of a .safetensors file.
        drives: in each family; in each map.
        seed: of the first.
        window: side of the square that the LIDAR writes into [m].
        expansion: predicted square over window.
        every: ticks between two predictions.
    """

    world: tuple[str, ...] = ("corridor", "narrow", "office", "paper", "trap")
    predictors: tuple[str, ...] = ("none", "extend", "compact")
    drives: int = 20
    seed: int = 0
    window: float = 5.0
    expansion: float = 2.0
    every: int = 10
