"""Polylines: the length along them."""

import numpy as np
from numpy.typing import NDArray


def arc_length(points: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the length of a polyline from its first point to each point [m], (n,).

    Args:
        points: x and y of each point in the first two columns, (n, 2 or more) [m].
    """
    return np.append(0.0, np.cumsum(np.hypot(*np.diff(points[:, :2], axis=0).T)))
