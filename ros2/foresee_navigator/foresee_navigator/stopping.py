"""The manoeuvre that stops the car when no decision can be made any more."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.control import Control
from foresee.mapping.conventions import TICK
from planner.motion.plan import Plan


def stop_after(
    plan: Plan, last_resort: NDArray[np.float64] | None, braking: float
) -> list[Control]:
    """Return the controls that stop the car after the first step of a plan.

    If the plan relies on predictions, these are the controls of its last resort. Otherwise the car
    brakes as hard as it can on the curve of the plan, where its body stays in observed cells.

    Args:
        plan: plan of which the first step is driven.
        last_resort: acceleration and curvature of each step of the last resort after the plan's
            first step, (n, 2) [m/s², 1/m]; None: the plan needs none.
        braking: deceleration of the car, positive [m/s²].

    Returns:
        Controls of the following ticks.
    """
    if last_resort is not None:
        return [Control(float(a), float(k), plan.gear) for a, k in last_resort]
    speeds = np.abs(plan.states[:, 3])
    along = np.concatenate([[0.0], np.cumsum(0.5 * TICK * (speeds[1:] + speeds[:-1]))])
    controls = list[Control]()
    at, speed = float(along[1]), float(speeds[1])
    while speed > 0.0:
        step = min(int(np.searchsorted(along, at, side="right")) - 1, len(plan.controls) - 1)
        controls.append(Control(-braking, float(plan.controls[step, 1]), plan.gear))
        slower = max(0.0, speed - braking * TICK)
        at += 0.5 * TICK * (speed + slower)
        speed = slower
    return controls
