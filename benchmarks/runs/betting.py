"""A test by betting of whether a rate is below a bound, on drives made one after the other."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

STAKES = np.linspace(0.02, 1.0, 50)
"""Shares of the largest stake that a gambler can survive; each has an equal part of the capital."""


def capital(losses: ArrayLike, bound: float) -> NDArray[np.float64]:
    """Compute the capital of a gambler who begins with 1 and bets that a mean is below a bound.

    If the mean of the losses is not below the bound, no bet is in the gambler's favour, and the
    chance that the capital ever reaches 1 / α is at most α (Ville's inequality). The test may
    therefore look after each drive, and stop when it is convinced. See Waudby-Smith and Ramdas,
    "Estimating means of bounded random variables by betting" (2024); the capital is spread over
    constant stakes, since which is best depends on the rate, which nobody knows.

    Args:
        losses: of the drives in their order, each in [0, 1], n of them.
        bound: on the mean, in (0, 1).

    Returns:
        The capital after each drive, (n,).
    """
    gains = 1.0 - STAKES * (np.asarray(losses, dtype=np.float64)[:, None] - bound) / (1.0 - bound)
    return np.asarray(np.cumprod(np.maximum(gains, 0.0), axis=0).mean(axis=1))
