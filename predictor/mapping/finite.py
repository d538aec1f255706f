"""Ranges of settings, refused where they make no sense."""

from __future__ import annotations

import math


def check_finite(settings: object, *names: str, zero: bool = False) -> None:
    """Refuse settings that are not positive and finite.

    Args:
        settings: whose attributes are looked at.
        names: of the attributes.
        zero: whether they may be 0.

    Raises:
        ValueError: if one is not; the message names it.
    """
    wanted = "finite and not negative" if zero else "positive and finite"
    for name in names:
        value = getattr(settings, name)
        if not (value >= 0 if zero else value > 0) or not value < math.inf:
            raise ValueError(f"{name} is {value}, it must be {wanted}")
