"""The tree of transforms of ROS (tf): the pose of one frame in another at any time."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

LONGEST_GAP = 1.0
"""Longest time between two transforms between which poses are interpolated [s]."""
MOST_FRAMES = 50
"""Longest chain of frames; a longer one is a loop."""


@dataclass
class Edge:
    """The transforms of one frame, the child, in its parent at several times.

    Attributes:
        parent: frame that the transforms are given in.
        fixed: whether the last transform holds at all times.
        times: times of the transforms [s].
        positions: x, y, z of each [m].
        turns: quaternion x, y, z, w of each.
    """

    parent: str
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
    """A tree of frames; each has one parent, the one that was added last."""

    def __init__(self) -> None:
        self.edges: dict[str, Edge] = {}

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
        edge = self.edges.get(child)
        if edge is None or edge.parent != parent or edge.fixed != fixed:
            edge = self.edges[child] = Edge(parent, fixed)
        edge.times.append(time)
        edge.positions.append(position)
        edge.turns.append(turn)

    def chain(self, child: str) -> list[str]:
        """Return a frame and its ancestors up to the root."""
        found = [child]
        while found[-1] in self.edges and len(found) < MOST_FRAMES:
            found.append(self.edges[found[-1]].parent)
        return found

    def carrier(self, child: str) -> str:
        """Return the topmost frame that a frame is fixed to: for a sensor, the robot."""
        for _ in range(MOST_FRAMES):
            edge = self.edges.get(child)
            if edge is None or not edge.fixed:
                break
            child = edge.parent
        return child

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
        for frame in self.chain(child):
            if frame == root:
                return positions, turn, known
            if frame in self.edges:
                offset, rotation, inside = self.edges[frame].at(times)
                positions = rotation.apply(positions) + offset
                turn, known = rotation * turn, known & inside
        raise KeyError(root)
