"""The revision of the driving, which tells whether a calibration still describes the drives."""

FIRST = 1
"""Revision of drives and calibrations that do not name theirs."""
REVISION = 6
"""Present revision. Raise it by 1 with each change of planner, simulator or tasks after which
drives in the default settings differ. 2: what beams through corners of cells observe, and the free
space that is assumed around the start. 3: routes that respect predicted walls, and plans that are
chosen together with their last resorts. 4: where last resorts must end, and that a car which would
hardly move drives on. 5: the default reliance is 0.3, which was 0.05. 6: free routes keep the same
clearance from predicted walls as from observed ones."""
ON_PRESCRIBED_ROUTES = 5
"""Revision of the last change that concerns drives on prescribed routes."""


def revision_of(route: str) -> int:
    """Return the revision of the last change that concerns drives on a kind of route.

    Args:
        route: "free" or "fixed".
    """
    return ON_PRESCRIBED_ROUTES if route == "fixed" else REVISION
