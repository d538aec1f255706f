"""NumPy's handling of floating-point errors, whatever the user's program has set."""

from __future__ import annotations

import numpy as np


def usual_float_errors() -> np.errstate:
    """Return a context, or a decorator, in which NumPy has its default handling of these errors.

    After `numpy.seterr(all="raise")` in a user's program, a small number that is rounded to half
    precision would end a drive.
    """
    return np.errstate(divide="warn", over="warn", under="ignore", invalid="warn")
