"""Settings of the paper's networks.

This module imports nothing heavy, since command lines are built from it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from predictor.networks import ARCHITECTURES

GIVEN = ("crop", "window")
"""Inputs of a network: the 5 m crop alone, as in the paper, or all that was observed inside the
expanded square."""
SIDES = (64, 128, 256)
"""Sides of images [pixels]."""
OVER = ("image", "batch")
"""Ways to normalise channels, see `predictor.networks.normalisation`."""
EXPANSIONS = (1.1, 1.3, 1.5, 1.7, 2.0)
"""Expansions that the paper trains for."""


@dataclass(frozen=True)
class ImageConfig:
    """Architecture, shape, inputs and outputs of a network of the paper.

    Attributes:
        arch: one of `ARCHITECTURES`.
        expansion: width of the predicted square divided by that of the 5 m crop.
        given: input, one of `GIVEN`.
        width: factor of the number of channels; 1 in the paper.
        side: side of the images [pixels]; the paper's 8 layers need 256.
        over: normalisation of the channels, one of `OVER`.
        turned: whether maps are rotated by quarter turns so that the robot faces +x to within 45°,
            as in samples of drives; frames are not rotated.
    """

    arch: str = "unet_ff"
    expansion: float = 1.1
    given: str = "crop"
    width: float = 1.0
    side: int = 256
    over: str = "image"
    turned: bool = False

    def __post_init__(self) -> None:
        choices = {
            "arch": ARCHITECTURES,
            "given": GIVEN,
            "side": SIDES,
            "over": OVER,
            "turned": (False, True),
        }
        for name, allowed in choices.items():
            if getattr(self, name) not in allowed:
                known = ", ".join(map(str, allowed))
                raise ValueError(f"{name} is {getattr(self, name)!r}, it must be one of {known}")
        for name, low, high in (("expansion", 1.0, 2.0), ("width", 1 / 64, 4.0)):
            if not low <= getattr(self, name) <= high:
                raise ValueError(
                    f"{name} is {getattr(self, name)}, it must lie between {low:g} and {high:g}"
                )

        if abs(50 * self.expansion - round(50 * self.expansion)) > 1e-6:
            raise ValueError(
                f"expansion is {self.expansion:g}, it must be one of 1, 1.02, … 2: "
                "squares are an even number of cells wide"
            )

    @classmethod
    def of(cls, fields: dict[str, Any]) -> ImageConfig:
        """Return the configuration that the header of a file of weights describes.

        Raises:
            ValueError: if no network can have this configuration.
            TypeError: if a field is unknown or of the wrong type; a missing one has its default.
        """
        return cls(**fields)
