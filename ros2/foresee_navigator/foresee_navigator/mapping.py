"""The observed map: how it begins, and how it grows while no navigator drives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.grid import GridFrame, OccupancyGrid
from foresee.mapping.scan import Scan
from planner.navigator_config import NavigatorConfig

FIRST_SIDE = 20.0
"""Side of a new map [m]; it grows as the robot moves."""


def new_map(
    config: NavigatorConfig, resolution: float, state: NDArray[np.float64]
) -> OccupancyGrid:
    """Return a map in which only the space around the car counts as free.

    Args:
        config: settings of the navigator.
        resolution: side of a cell [m].
        state: x, y, yaw of the car, (3,) or more [m, m, rad].
    """
    cells = round(FIRST_SIDE / resolution)
    x, y = (float(value) for value in state[:2])
    # Its lattice has a corner at (0, 0), so that maps of one frame are comparable.
    corner = (
        resolution * round((x - 0.5 * FIRST_SIDE) / resolution),
        resolution * round((y - 0.5 * FIRST_SIDE) / resolution),
    )
    known = OccupancyGrid(GridFrame(resolution, corner, (cells, cells)), config.window)
    known.mark_free(state, config.car.body, config.start_margin)
    return known


def observe(
    known: OccupancyGrid, scan: Scan, state: NDArray[np.float64], config: NavigatorConfig
) -> bool:
    """Add a scan to a map, and return whether it could be read.

    Args:
        known: map, which is changed.
        scan: scan.
        state: x, y, yaw of the car, (3,) or more [m, m, rad].
        config: settings of the navigator.
    """
    try:
        known.integrate(scan, state, config.bounds)
        return True
    except ValueError:
        return False
    finally:
        known.mark_under(state, config.car.body, config.bounds)
