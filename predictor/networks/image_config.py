"""What decides a network of the paper and its training, and the presets.

Nothing heavy is imported here: the command line is built from it.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from predictor.networks import ARCHITECTURES

GIVEN = ("crop", "window")
"""What a network may be given: the 5 m crop alone, as in the paper, or all that was seen inside
its expanded square."""
SIDES = (64, 128, 256)
"""Of images [pixels]."""
OVER = ("image", "batch")
"""What channels are normalised over, see `predictor.networks.normalisation`."""
EXPANSIONS = (1.1, 1.3, 1.5, 1.7, 2.0)
"""That the paper trains for."""
WINDOW = 5.0
"""Side of the crop that is expanded [m]."""


@dataclass(frozen=True)
class ImageConfig:
    """Shape and meaning of a network.

    Attributes:
        arch: one of `ARCHITECTURES`.
        expansion: of the 5 m crop.
        given: one of `GIVEN`.
        width: factor of all channels; 1 is the paper's.
        side: of the images [pixels]; 256 is what the paper's 8 layers need.
        over: one of `OVER`.
        turned: whether maps are turned by quarters before, so that the robot looks along +x to
            within 45°, as in the samples of drives; the paper's frames are not.
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
            raise ValueError(f"expansion is {self.expansion:g}, it must be one of 1, 1.02, … 2: "
                             "squares are an even number of cells wide")  # fmt: skip

    @classmethod
    def of(cls, fields: dict[str, Any]) -> ImageConfig:
        """The configuration that a header claims.

        Raises:
            ValueError: if no network can have it.
            TypeError: if something is missing, too much, or of the wrong kind.
        """
        return cls(**fields)


@dataclass(frozen=True)
class ImageTraining:
    """What else decides the numbers of a training.

    Attributes:
        epochs: times that every frame is learnt from; need not be whole.
        batch: frames a step, over all processes.
        rate: learning rate of Adam; it falls linearly to nothing over the second half.
        sigma: standard deviation of the first weights.
        brief: bfloat16 where it may stand in for single precision.
        seed: of the first weights, of the order of frames and of dropout.
    """

    epochs: float = 200.0
    batch: int = 1
    rate: float = 2e-4
    sigma: float = 0.02
    brief: bool = False
    seed: int = 0

    def __post_init__(self) -> None:
        for name, low, high in (("epochs", 0.0, 1e6), ("rate", 0.0, 1.0), ("sigma", 0.0, 10.0)):
            if not low < getattr(self, name) <= high:
                raise ValueError(
                    f"{name} is {getattr(self, name)}, it must lie in ({low:g}, {high:g}]"
                )
        for name, least in (("batch", 1), ("seed", 0)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} is {getattr(self, name)}, it must be at least {least}")


@dataclass(frozen=True)
class Preset:
    """A size and a schedule, the same for all architectures.

    Attributes:
        width: of `ImageConfig`.
        side: of `ImageConfig` [pixels].
        training: the schedule.
    """

    width: float
    side: int
    training: ImageTraining


PRESETS = {
    "paper": Preset(1.0, 256, ImageTraining()),
    "short": Preset(0.125, 128, ImageTraining(epochs=4.0, batch=8, rate=1e-3)),
}
"""`paper` is Katyal et al. 2018's. `short` is what 2 CPU cores do, for all 20 networks, in two
or three hours, and is nobody's but ours."""


def described(
    config: ImageConfig, training: ImageTraining, digests: tuple[str, str]
) -> dict[str, Any]:
    """What tells one training from another, in checkpoints and weights.

    Args:
        config: the network.
        training: how it learns.
        digests: of the frames to learn from, and of those to validate on.
    """
    return {"config": asdict(training), "network": asdict(config),
            "data": list(digests)}  # fmt: skip
