"""The check that settings are finite numbers."""

from __future__ import annotations

import math


def check_finite(settings: object, *names: str, zero: bool = False) -> None:
    """Check that settings are positive and finite.

    Args:
        settings: object that holds them.
        names: names of the attributes to check.
        zero: whether 0 is allowed.

    Raises:
        ValueError: if a setting is not; the message names it.
    """
    wanted = "finite and not negative" if zero else "positive and finite"
    for name in names:
        value = getattr(settings, name)
        if not (value >= 0 if zero else value > 0) or not value < math.inf:
            raise ValueError(f"{name} is {value}, it must be {wanted}")
