"""The arms of a comparison: variants of the car that differ in what they know and rely on."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Arm:
    """One arm (variant) of a comparison: how much of the map its planner may know and rely on.

    Attributes:
        predictor: "none", "chosen" (the predictor of --predictor), "free" (all unobserved cells of
            the predicted square are free) or "oracle" (its true map).
        reliance: reliance ε; None: the value of --reliance.
        steer: whether the prediction influences the route.
        whole_map: whether the whole map is known from the start.
        frontiers: whether a prediction of where each frontier leads influences the route, which
            must be free (--route free).
        level: level λ of the last resort, which is not adapted; None: the value of --level, or the
            one certified for --risk, which is adapted.
        side: side of the square of the true map that "oracle" gives [m]; 0: the predicted square.
    """

    predictor: str
    reliance: float | None
    steer: bool
    whole_map: bool
    frontiers: bool = False
    level: float | None = 0.0
    side: float = 0.0

    @property
    def takes_risk(self) -> bool:
        """Whether --risk and --level apply to this arm."""
        return self.level is None

    @property
    def may_collide(self) -> bool:
        """Whether the arm may collide at a risk of 0: unobserved cells count as free."""
        return self.reliance == 1.0

    @property
    def has_predictor(self) -> bool:
        """Whether the drives depend on a predictor, whose code may change between two runs."""
        return self.predictor == "chosen" or self.frontiers

    def drives_alike(self, differing: set[str]) -> bool:
        """Return whether this arm makes the same drives in two runs with different settings.

        False for an arm with a predictor, see `has_predictor`.

        Args:
            differing: names of the settings in which the two runs differ.
        """
        heedless = {
            "predictor",
            "weights",
            "frontiers",
            "risk",
            "level",
            "uncertified",
            "calibrated",
            "fixed_level",
        }
        if self.predictor == "none":
            heedless.add("expansion")
        if self.reliance is not None:
            heedless.add("reliance")
        return not self.has_predictor and differing <= heedless


ARMS = {
    # Only cells that were observed free; no prediction.
    "known": Arm(predictor="none", reliance=0.0, steer=False, whole_map=False),
    # Only cells that were observed free; the prediction influences the route.
    "known+route": Arm(predictor="chosen", reliance=0.0, steer=True, whole_map=False),
    # All cells that were not observed occupied, as if they were predicted free; its last resort
    # enters cells that were observed free alone. Any reliance between 0 and 1 does the same.
    "backup": Arm(predictor="free", reliance=0.5, steer=False, whole_map=False),
    # Also predicted cells, at the given reliance and level; the prediction influences the route.
    "predicted": Arm(predictor="chosen", reliance=None, steer=True, whole_map=False, level=None),
    # As known; and a prediction of where each frontier leads influences the free route.
    "known+frontiers": Arm(
        predictor="none", reliance=0.0, steer=False, whole_map=False, frontiers=True
    ),
    "known+route+frontiers": Arm(
        predictor="chosen", reliance=0.0, steer=True, whole_map=False, frontiers=True
    ),
    # As known; and the true map of a square influences the route: the most that a predictor of that
    # square can be worth to it.
    **{
        f"known+truth{side}": Arm(
            predictor="oracle", reliance=0.0, steer=True, whole_map=False, side=float(side)
        )
        for side in (10, 20, 40)
    },
    # All cells that were not observed occupied, without a last resort.
    "optimistic": Arm(predictor="none", reliance=1.0, steer=False, whole_map=False),
    # As predicted at a risk of 0, but the prediction is the true map of the predicted square.
    "perfect": Arm(predictor="oracle", reliance=None, steer=True, whole_map=False),
    # The upper bound: as perfect, and its last resort relies on the true map as well. The
    # probabilities of that map are 0 and 1, so that any level above 0 does.
    "oracle": Arm(predictor="oracle", reliance=None, steer=True, whole_map=False, level=1e-9),
    # All free cells; the whole map is known from the start.
    "full": Arm(predictor="none", reliance=0.0, steer=False, whole_map=True),
}
CALIBRATED_ARM = "predicted"
"""The arm that calibrations are of; no other may drive at a level that one certifies."""


def arm_at(risk: float) -> str:
    """Return the name of `CALIBRATED_ARM` at a risk, such as "predicted 2 %"; at 0 its own."""
    return f"{CALIBRATED_ARM} {100 * risk:g} %" if risk > 0 else CALIBRATED_ARM


def arm_kind(name: str) -> str:
    """Return the key in `ARMS` of an arm that may be named with its risk, see `arm_at`."""
    return name.partition(" ")[0]


def arm_risk(name: str) -> float:
    """Return the risk of an arm that may be named with it, see `arm_at`; else 0."""
    percent = name.partition(" ")[2].removesuffix(" %")
    return float(percent) / 100 if percent else 0.0
