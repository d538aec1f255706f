"""The recorder: collect what happens in each tick of a drive, and return it as arrays."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.grid import GridFrame, OccupancyGrid, paste
from sim.driver_protocol import Decision
from sim.world import World

SHAPES: dict[str, tuple[int | str, ...] | str] = {
    # x, y [m], yaw [rad], v [m/s] at the start and at the end of each tick; v < 0 in reverse.
    "states": ("any", 4),
    # Acceleration [m/s²] and curvature [1/m].
    "controls": ("T", 2),
    # Gear of the plan, 1 or -1.
    "gears": ("T",),
    # Controls of the plan, in half precision.
    "plans": ("T", "any", 2),
    # Controls of the manoeuvre that stops the car if no decision follows, in half precision.
    "last_resorts": ("T", "any", 2),
    # What kept the car from going faster, as an index into `limit_names`.
    "limits": ("T",),
    "limit_names": ("any",),
    # Whether no plan was safe.
    "emergency": ("T",),
    # Number of unobserved cells that the plan sweeps.
    "relied_count": ("T",),
    # Row and column of these cells in the frame of the world, of all ticks.
    "relied_cells": ("any", 2),
    # 1 if none of them was solid, 0 if one was, -1 if there were none.
    "kept": ("T",),
    # Duration of each stage in `time_names` [ms]; 0 if it did not run.
    "times": ("T", "any"),
    "time_names": ("any",),
    # Tick, from 1, in which a cell of the world was first observed; 0: never.
    "first_seen": "world",
}
"""Array of the trace of a drive → its shape for a drive of T ticks, or the name of an array of the
same shape; "world": the shape of the world's map."""


class Recorder:
    """Collects the trace of a drive.

    Args:
        world: building of the drive, whose true map shows whether predictions were right.
    """

    def __init__(self, world: World) -> None:
        self.world = world
        self.faults: Counter[str] = Counter()
        self._first_seen = np.zeros(world.grid.frame.shape, dtype=np.int32)
        self._ticks: list[dict[str, Any]] = []
        self._time_names: list[str] = []

    def record(
        self,
        decision: Decision,
        state: NDArray[np.float64],
        known: OccupancyGrid,
        scan_ms: float,
    ) -> None:
        """Record a tick.

        Args:
            decision: decision of the driver.
            state: estimated x, y, yaw, v of the car, (4,).
            known: map of all that the driver has observed.
            scan_ms: duration of the scan's simulation [ms].
        """
        tick = len(self._ticks)
        self.faults.update(decision.faults)
        cells, kept = self._relied_upon(decision)
        times = {"scan": scan_ms, **decision.times}
        # The stages of the first tick may come in another order, or be others.
        self._time_names += [name for name in times if name not in self._time_names]
        self._ticks.append(
            {
                "control": (decision.control.acceleration, decision.control.curvature),
                "gear": decision.plan.gear,
                "plan": decision.plan.controls.astype(np.float16),
                "last_resort": decision.last_resort.astype(np.float16),
                "limit": str(decision.limit),
                "emergency": decision.emergency,
                "relied_cells": cells,
                "kept": kept,
                "times": times,
            }
        )
        see(self._first_seen, self.world.grid.frame, tick, state, known)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays of the trace by name, see `SHAPES`, without the states."""

        def column(name: str, kind: type) -> NDArray[Any]:
            return np.array([tick[name] for tick in self._ticks], dtype=kind)

        cells = [tick["relied_cells"] for tick in self._ticks]
        names = sorted({tick["limit"] for tick in self._ticks})
        return {
            "controls": column("control", np.float32),
            "gears": column("gear", np.int8),
            "plans": _stacked([tick["plan"] for tick in self._ticks]),
            "last_resorts": _stacked([tick["last_resort"] for tick in self._ticks]),
            "limits": np.array([names.index(t["limit"]) for t in self._ticks], dtype=np.uint8),
            "limit_names": np.array(names),
            "emergency": column("emergency", bool),
            "relied_count": np.array(list(map(len, cells)), dtype=np.int32),
            "relied_cells": np.concatenate(cells),
            "kept": column("kept", np.int8),
            "times": np.array(
                [
                    [tick["times"].get(name, 0.0) for name in self._time_names]
                    for tick in self._ticks
                ],
                dtype=np.float32,
            ),
            "time_names": np.array(self._time_names),
            "first_seen": self._first_seen,
        }

    def _relied_upon(self, decision: Decision) -> tuple[NDArray[np.int16], int]:
        """Return row and column of the unobserved cells that a plan sweeps, (k, 2), and `kept`."""
        frame, solid = self.world.grid.frame, self.world.solid
        cells = np.floor((decision.relied - np.array(frame.origin)) / frame.resolution)
        cells = cells[:, ::-1].astype(np.int16)
        if len(cells) == 0:
            return cells, -1
        inside = ((cells >= 0) & (cells < np.array(frame.shape))).all(axis=1)
        broken = bool((~inside).any()) or bool(solid[tuple(cells[inside].T)].any())
        return cells, int(not broken)


def _stacked(motions: list[NDArray[np.float16]]) -> NDArray[np.float16]:
    """Return the controls of motions in one array, (T, N, 2).

    Motions in reverse have fewer steps; zeros follow them, during which the car rests.
    """
    longest = max(map(len, motions))
    return np.array([np.pad(m, ((0, longest - len(m)), (0, 0))) for m in motions])


def see(
    first_seen: NDArray[np.int32],
    frame: GridFrame,
    tick: int,
    state: NDArray[np.float64],
    known: OccupancyGrid,
) -> None:
    """Write a tick to cells of the LIDAR's window that are observed for the first time, in place.

    Args:
        first_seen: tick, from 1, in which each cell was first observed; 0: not yet.
        frame: frame of these cells.
        tick: number of the tick, from 0.
        state: x, y, ... of the car.
        known: map of all that was observed, after the scan of the tick.
    """
    window = known.frame.square(state[0], state[1], known.window)
    here, there = frame.overlap(window)
    part = first_seen[here]
    seen = paste(known.frame, known.log_odds, window, np.int8(0))[there] != 0
    part[seen & (part == 0)] = tick + 1
