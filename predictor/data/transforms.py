"""The transforms of ROS (tf): the pose of one frame in another at any time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

LONGEST_GAP = 1.0
"""Longest time between two transforms between which poses are interpolated [s]."""
SHORTEST = 1e-6
"""Smallest norm of a quaternion that counts as a rotation; drivers send zeros before they know."""


@dataclass
class Edge:
    """The transforms of one frame, the child, in another, its parent, at several times.

    Attributes:
        fixed: whether the last transform holds at all times.
        times: times of the transforms [s].
        positions: x, y, z of each [m].
        turns: quaternion x, y, z, w of each.
    """

    fixed: bool
    times: list[float] = field(default_factory=list)
    positions: list[tuple[float, float, float]] = field(default_factory=list)
    turns: list[tuple[float, float, float, float]] = field(default_factory=list)

    def at(self, times: NDArray[np.float64]) -> tuple[NDArray[np.float64], Rotation, NDArray[Any]]:
        """Return positions (n, 3), rotations, and whether they are known at each time (n,)."""
        if self.fixed:
            count = len(times)
            turn = Rotation.from_quat(np.tile(self.turns[-1], (count, 1)))
            return np.tile(self.positions[-1], (count, 1)), turn, np.ones(count, dtype=bool)
        known, order = np.unique(np.array(self.times), return_index=True)
        positions, turns = np.array(self.positions)[order], np.array(self.turns)[order]
        after = np.clip(np.searchsorted(known, times), 1, max(1, len(known) - 1))
        gaps = known[np.minimum(after, len(known) - 1)] - known[after - 1]
        inside = (times >= known[0]) & (times <= known[-1])
        inside &= (gaps <= LONGEST_GAP) | np.isin(times, known)
        at = np.clip(times, known[0], known[-1])
        moved = np.stack([np.interp(at, known, positions[:, axis]) for axis in range(3)], axis=1)
        if len(known) == 1:
            return moved, Rotation.from_quat(np.tile(turns[0], (len(at), 1))), inside
        return moved, Slerp(known, Rotation.from_quat(turns))(at), inside


class Transforms:
    """A graph of frames; a frame may have several parents, of which a look-up takes one path.

    Attributes:
        edges: child → parent → transforms of the child in the parent.
        bad: number of transforms that were left out, since they hold NaN or no rotation.
    """

    def __init__(self) -> None:
        self.edges: dict[str, dict[str, Edge]] = {}
        self.bad = 0

    def add(
        self,
        parent: str,
        child: str,
        time: float,
        position: tuple[float, float, float],
        turn: tuple[float, float, float, float],
        fixed: bool = False,
    ) -> None:
        """Add the pose of a child in its parent at a time [s]: position [m], quaternion x y z w."""
        if not np.isfinite((time, *position, *turn)).all() or math.hypot(*turn) < SHORTEST:
            self.bad += 1
            return
        parents = self.edges.setdefault(child, {})
        edge = parents.get(parent)
        if edge is None or edge.fixed != fixed:
            edge = parents[parent] = Edge(fixed)
        edge.times.append(time)
        edge.positions.append(position)
        edge.turns.append(turn)

    @property
    def frames(self) -> list[str]:
        """Names of all frames, sorted."""
        return sorted({*self.edges, *(name for parents in self.edges.values() for name in parents)})

    def paths(self, child: str) -> dict[str, list[str]]:
        """Return the ancestors of a frame, the nearest first, each with the frames on the way.

        A path starts with `child` and ends with the ancestor; `child` itself is the first one.
        """
        paths, front = {child: [child]}, [child]
        for frame in front:
            for parent in self.edges.get(frame, {}):
                if parent not in paths:
                    paths[parent] = [*paths[frame], parent]
                    front.append(parent)
        return paths

    def carrier(self, child: str) -> str:
        """Return the topmost frame that a frame is fixed to: for a sensor, the robot."""
        passed = {child}
        while True:
            fixed = [name for name, edge in self.edges.get(child, {}).items() if edge.fixed]
            if not fixed or fixed[-1] in passed:
                return child
            child = fixed[-1]
            passed.add(child)

    def look_up(
        self, root: str, child: str, times: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], Rotation, NDArray[Any]]:
        """Return the poses of a frame in an ancestor at some times.

        Args:
            root: the ancestor.
            child: the frame.
            times: times of the poses, (n,) [s].

        Returns:
            Positions (n, 3) [m], rotations, and whether each pose is known, (n,).

        Raises:
            KeyError: if `root` is not an ancestor of `child`.
        """
        positions = np.zeros((len(times), 3))
        turn = Rotation.from_quat(np.tile((0.0, 0.0, 0.0, 1.0), (len(times), 1)))
        known = np.ones(len(times), dtype=bool)
        for frame, parent in pairwise(self.paths(child)[root]):
            offset, rotation, inside = self.edges[frame][parent].at(times)
            positions = rotation.apply(positions) + offset
            turn, known = rotation * turn, known & inside
        return positions, turn, known
