"""The drives that a report replays, as JSON: arrays are zlib-compressed bytes in base64."""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skimage.measure import block_reduce

from benchmarks.figures.animation import roll_out
from benchmarks.figures.moment import BELIEVED_FREE, BELIEVED_OCCUPIED
from benchmarks.figures.palette import (
    CRASH_COLOUR,
    FREE_COLOUR,
    LIMIT_COLOURS,
    MARKS,
    OCCUPIED_COLOUR,
    RELIED_COLOUR,
    UNKNOWN_COLOUR,
    arm_colour,
    shrink,
)
from benchmarks.runs.arms import ARMS, arm_kind
from benchmarks.runs.beliefs import BLOCK, CERTAIN
from benchmarks.runs.saved_run import Run
from benchmarks.runs.trace import RunError, Trace
from foresee.infra.drawing import INK
from foresee.mapping.grid import GridFrame

CELL, LARGEST = 0.1, 1000
"""Side of a cell of the shown maps, at least [m]; largest number of their rows or columns."""
MARGIN = 2.0
"""Margin of the shown map around the cells that were observed [m]."""
EVERY = 2
"""Every how many states a plan and a last resort have a point."""
COLOURS = {
    "ink": INK,
    "free": FREE_COLOUR,
    "occupied": OCCUPIED_COLOUR,
    "unknown": UNKNOWN_COLOUR,
    "likely_free": BELIEVED_FREE,
    "likely_occupied": BELIEVED_OCCUPIED,
    "relied": RELIED_COLOUR,
    "plan": INK,
    "last_resort": CRASH_COLOUR,
    "goal": MARKS["goal"]["color"],
}
"""Name of what is drawn → its colour; `replay.js` uses these names."""
REASONS = {
    "top speed": "It drives at its top speed.",
    "acceleration": "It speeds up as hard as it can.",
    "turn": "The turn allows no more.",
    "unseen space": "It must be able to stop before space that it has not seen, and may not enter.",
    "obstacle": "An obstacle lies ahead of its plan.",
    "path": "Its path ends or bends there, although the space ahead is free.",
    "goal": "Its plan ends at the goal.",
    "emergency": "No plan is safe: it brakes as hard as it can.",
}
"""What limited the speed → the same in a sentence."""


class ReplayData:
    """The drives of a run that a report replays: whole episodes, as many as fit.

    Args:
        run: run that contains the drives.
        order: numbers of the episodes, the most interesting first.
        most: largest size of the drives together [bytes].

    Attributes:
        episodes: objects with the map of each building.
        drives: objects with the arrays of each drive.

    Raises:
        RunError: if a trace is missing or broken.
    """

    def __init__(self, run: Run, order: Iterable[int], most: int) -> None:
        self._run = run
        self.episodes: list[dict[str, Any]] = []
        self.drives: list[dict[str, Any]] = []
        size = 0
        for index in order:
            episode, drives = self._episode(index)
            size += len(json.dumps([episode, drives]))
            if size > most:
                break
            self.episodes.append(episode)
            self.drives += drives
        self.episodes.sort(key=lambda episode: int(episode["index"]))

    @property
    def indices(self) -> set[int]:
        """Numbers of the episodes."""
        return {episode["index"] for episode in self.episodes}

    def json(self) -> str:
        """Return what `replay.js` reads, as JSON that may stand in an element `script`."""
        run = self._run
        limits = dict.fromkeys(name for drive in self.drives for name in drive["limit_names"])
        content = {
            "dt": run.setting("dt"),
            "v_max": run.setting("v_max"),
            "window": run.setting("window"),
            "body": [run.body.length, run.body.width],
            "block": BLOCK,
            "certain": CERTAIN,
            "colours": COLOURS | {"limits": LIMIT_COLOURS},
            "reasons": {name: REASONS[name] for name in limits if name in REASONS},
            "arms": {arm: arm_colour(arm) for arm in run.arms},
            "shown_first": run.pick_arm(None),
            "episodes": self.episodes,
            "drives": self.drives,
        }
        return json.dumps(content, separators=(",", ":")).replace("<", "\\u003c")

    def _episode(self, index: int) -> tuple[dict[str, Any], list[dict[str, Any]]]:
        """Return the objects of an episode and of its drives."""
        run = self._run
        traces = [run.trace(index, arm) for arm in run.driven_arms(index)]
        truth = traces[0].truth
        part = _observed_part(traces, truth.frame)
        side = max(CELL, max(part.size) / LARGEST)
        factor = max(1, math.ceil(side / part.resolution - 1e-6))
        cells = shrink(truth.crop(part).cells, factor)
        result = run.drives[index, traces[0].arm]
        episode = {
            "index": index,
            "building": result.world,
            "goal": result.goal,
            "origin": part.origin,
            "factor": factor,
            "cell": factor * part.resolution,
            "shape": cells.shape,
            "cells": _packed(cells, "<i1"),
        }
        return episode, [dict(self._drive(trace, part, factor)) for trace in traces]

    def _drive(self, trace: Trace, part: GridFrame, factor: int) -> Iterator[tuple[str, Any]]:
        """Yield the name and the value of each entry of a drive's object."""
        result, states, offset = (
            self._run.drives[trace.index, trace.arm],
            trace.states,
            trace.truth.frame.offset(part),
        )
        names = sorted(set(trace.limits))
        yield "index", trace.index
        yield "arm", trace.arm
        yield "outcome", result.outcome.replace("_", " ")
        yield "limit_names", names
        yield "limits", _packed([names.index(limit) for limit in trace.limits], "<u1")
        # In millimetres, 1e-4 rad, and mm/s.
        yield "states", _packed(states * [1e3, 1e3, 1e4, 1e3], "<i4")
        yield "first_seen", _packed(_first_seen(trace, part, factor), "<u2")
        yield "plans", _packed(self._motions(trace, trace.plans), "<i2")
        if "last_resorts" in trace and _has_last_resort(trace.arm):
            motions = self._motions(trace, trace.read("last_resorts"))
            yield "last_resorts", _packed(motions, "<i2")
        # Several cells that a plan relies on may be one cell of the shown map.
        counts, relied = _relied(trace, part, factor)
        yield "relied_counts", _packed(counts, "<u2")
        yield "relied", _packed(relied, "<u2")
        if "beliefs" in trace:
            beliefs, corners = trace.read("beliefs"), trace.read("belief_corners")
            yield "belief_shape", beliefs.shape[1:]
            yield "beliefs", _packed(beliefs, "<i1")
            # In cells of the building's map from the corner of the shown part.
            yield "belief_corners", _packed(corners.astype(int) * BLOCK - offset, "<i4")

    def _motions(self, trace: Trace, controls: NDArray[Any]) -> NDArray[np.float64]:
        """Return the points of each tick's motion, from the car on, (T, n, 2) [cm]."""
        starts = trace.states[:-1]
        states = roll_out(starts, controls, self._run.setting("dt"), trace.gears)
        return 100.0 * (states[:, ::EVERY, :2] - starts[:, None, :2])


def _has_last_resort(arm: str) -> bool:
    kind = arm_kind(arm)
    return kind in ARMS and not ARMS[kind].may_collide


def _observed_part(traces: list[Trace], frame: GridFrame) -> GridFrame:
    """Return the part of a building that any of its drives has observed, with a margin."""
    seen = np.logical_or.reduce([trace.first_seen > 0 for trace in traces])
    margin = math.ceil(MARGIN / frame.resolution)
    ends = []
    for axis in (1, 0):
        found = np.flatnonzero(seen.any(axis=axis))
        first, last = (found[0], found[-1]) if len(found) else (0, 0)
        size = seen.shape[1 - axis]
        ends.append((max(0, int(first) - margin), min(size, int(last) + 1 + margin)))
    (top, bottom), (left, right) = ends
    x, y = frame.origin
    origin = x + left * frame.resolution, y + top * frame.resolution
    return GridFrame(frame.resolution, origin, (bottom - top, right - left))


def _relied(
    trace: Trace, part: GridFrame, factor: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return how many shown cells each tick's plan relies on, (T,), and these cells, (k, 2)."""
    ticks = np.repeat(np.arange(len(trace.relied_count)), trace.relied_count)
    cells = trace.read("relied_cells").astype(np.int64) - trace.truth.frame.offset(part)
    inside = ((cells >= 0) & (cells < np.array(part.shape))).all(axis=1)
    found = np.unique(np.column_stack([ticks, cells // factor])[inside], axis=0)
    return np.bincount(found[:, 0], minlength=len(trace.relied_count)), found[:, 1:]


def _first_seen(trace: Trace, part: GridFrame, factor: int) -> NDArray[np.int64]:
    """Return the tick, from 1, in which each shown cell was first observed; 0: never."""
    there, _ = trace.truth.frame.overlap(part)
    ticks = trace.first_seen[there].astype(np.int64)
    never = np.iinfo(np.uint16).max
    ticks = block_reduce(np.where(ticks > 0, ticks, never), factor, np.min, cval=never)
    return np.where(ticks < never, ticks, 0)


def _packed(numbers: Any, kind: str) -> str:
    """Return numbers as little-endian bytes, zlib-compressed, in base64; they must fit the type.

    Raises:
        RunError: if a number does not fit.
    """
    rounded = np.rint(np.asarray(numbers, dtype=np.float64))
    limits = np.iinfo(np.dtype(kind))
    if rounded.size and not (limits.min <= rounded.min() and rounded.max() <= limits.max):
        held = f"{rounded.min():g} to {rounded.max():g}"
        raise RunError(f"a trace holds {held}, and not {limits.min} to {limits.max}")
    return base64.b64encode(zlib.compress(rounded.astype(kind).tobytes())).decode()
