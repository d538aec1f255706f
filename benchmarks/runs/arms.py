"""The arms of a comparison: one planner, and how much of the world each lets it know."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from predictor.mapping.grid import Grid
from predictor.prediction import Prediction, Predictor
from sim.world import World


@dataclass(frozen=True)
class Arm:
    """What one arm may rely upon.

    Attributes:
        predictor: "none", "chosen" (by the user) or "oracle".
        risk: ε; None: the user's.
        steer: whether the prediction moves the route.
        whole_map: whether all of the world is known from the start.
        about: a line for people.
    """

    predictor: str
    risk: float | None
    steer: bool
    whole_map: bool
    about: str

    def drives_alike(self, differing: set[str]) -> bool:
        """Whether this arm's drives are the same in comparisons that differ in some settings.

        Never of an arm with the chosen predictor: its code may have changed, whatever its name.

        Args:
            differing: names of these settings.
        """
        heedless = {"predictor", "weights"}
        if self.predictor == "none":
            heedless.add("expansion")
        if self.risk is not None:
            heedless.add("risk")
        return self.predictor != "chosen" and differing <= heedless


ARMS = {
    "known": Arm("none", 0.0, False, False, "what was seen, no prediction at all"),
    "known+route": Arm(
        "chosen", 0.0, True, False, "what was seen; the prediction steers the route"
    ),
    "predicted": Arm("chosen", None, True, False, "the prediction, at the stated risk"),
    "optimistic": Arm("none", 1.0, False, False, "all that was not seen occupied"),
    "oracle": Arm("oracle", None, True, False, "the truth inside the predicted window"),
    "full": Arm("none", 0.0, False, True, "the whole map"),
}


class Oracle:
    """A predictor that is told the truth: free and occupied, inside the window it is asked for.

    Args:
        world: the truth.
    """

    def __init__(self, world: World) -> None:
        self.world = world

    def predict(self, known: Grid, pose: NDArray[np.float64]) -> Prediction:
        """The truth, with full confidence."""
        free, surface = self.world.truth(known.frame)
        return Prediction(
            known.frame,
            free.astype(np.float32),
            surface.astype(np.float32),
            np.ones(known.frame.shape, dtype=np.float32),
        )


def predictor_for(arm: Arm, chosen: Predictor, world: World) -> Predictor | None:
    """The predictor that an arm drives with in a world."""
    if arm.predictor == "oracle":
        return Oracle(world)
    return chosen if arm.predictor == "chosen" else None
