"""The arms of a comparison: one planner, and how much of the world each lets it know."""

from __future__ import annotations

from dataclasses import dataclass


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
        """Return whether this arm drives alike in comparisons with some settings different.

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
