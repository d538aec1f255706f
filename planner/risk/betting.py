"""A sequential test by betting of whether a mean loss is below a bound."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

STAKES = np.linspace(0.02, 1.0, 50)
"""Stakes, as shares of the largest stake that cannot cost all capital; each is bet with an equal
part of the capital."""
LOST = 0.25
"""Capital below which the test of a level is given up, to save drives in which it would seldom
recover. This makes no false certificate more probable."""


def capital(losses: ArrayLike, bound: float) -> NDArray[np.float64]:
    """Compute the capital of a gambler who starts with 1 and bets that a mean is below a bound.

    If the mean of the losses is not below the bound, no bet is favourable, and the probability that
    the capital ever reaches 1 / α is at most α (Ville's inequality). The test may therefore be
    evaluated after each drive, and stopped as soon as the capital suffices. See Waudby-Smith and
    Ramdas, "Estimating means of bounded random variables by betting" (2024). The capital is spread
    over several constant stakes, since the best one depends on the unknown mean.

    Args:
        losses: loss of each drive in order, each in [0, 1], (n,).
        bound: bound of the mean, in (0, 1).

    Returns:
        The capital after each drive, (n,).
    """
    gains = 1.0 - STAKES * (np.asarray(losses, dtype=np.float64)[:, None] - bound) / (1.0 - bound)
    return np.asarray(np.cumprod(np.maximum(gains, 0.0), axis=0).mean(axis=1))


def decided_after(losses: ArrayLike, bound: float, most: int, wanted: float) -> int | None:
    """Return the number of drives after which a test is decided; None: not yet.

    It is decided as soon as the gambler's capital suffices, is lost, or can no longer suffice even
    if none of the remaining drives collides.

    Args:
        losses: loss of each drive so far, each in [0, 1], (n,).
        bound: bound of the mean that is tested, in (0, 1).
        most: largest number of drives.
        wanted: capital that certifies the bound.
    """
    money = capital(losses, bound)
    best = money * (1.0 + bound / (1.0 - bound)) ** (most - 1.0 - np.arange(len(money)))
    clear = (money >= wanted) | (money < LOST) | (best < wanted)
    return int(np.argmax(clear)) + 1 if clear.any() else None


def needed(confidence: float) -> float:
    """Return the capital that certifies, with a confidence, that the mean is below the bound."""
    return 1.0 / (1.0 - confidence)
