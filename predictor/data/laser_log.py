"""The log of a real robot: scans, and the pose of each."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from foresee.infra.errors import LineError
from foresee.mapping.scan import Scan

FARTHEST = 1e7
"""Largest coordinate of a pose [m]; larger ones are refused."""


class LogError(LineError):
    """A log cannot be read; the message is one line."""


@dataclass(frozen=True, eq=False)
class LaserLog:
    """Scans of a planar LIDAR, and the corrected pose of each.

    Attributes:
        name: name of the site.
        scans: scans in the order in which they were taken; each has its sensor's range.
        poses: x, y [m], yaw [rad] of the sensor at each scan, (n, 3).
        times: times of the scans [s], (n,); None if the log's clock cannot be used.
        skipped: what was skipped, and how often: "bad ranges" (NaN or negative), "bad scans"
            (without beams, or with directions or a range that make no sense), "bad transforms"
            (NaN, or no rotation), "scans without a pose".
        notes: one line for each property of the log that the reader worked around.
    """

    name: str
    scans: tuple[Scan, ...]
    poses: NDArray[np.float64]
    times: NDArray[np.float64] | None
    skipped: dict[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.scans:
            raise LogError(f"{self.name} holds no scan")
        if self.poses.shape != (len(self.scans), 3) or not np.isfinite(self.poses).all():
            raise LogError(f"{self.name}: each scan needs a pose of three finite numbers")
        if np.abs(self.poses[:, :2]).max() > FARTHEST:
            raise LogError(
                f"{self.name}: a pose lies {np.abs(self.poses[:, :2]).max():.3g} m from "
                f"the origin, more than {FARTHEST:g} m"
            )

    def __len__(self) -> int:
        return len(self.scans)


def cleaned(ranges: NDArray[np.float64], shortest: float) -> tuple[NDArray[np.float64], int]:
    """Return ranges as `Scan` wants them, and the number of bad ones.

    Bad ranges (NaN or negative) and those below the sensor's shortest become NaN, which says
    nothing. Ranges at or above the longest stay as they are.

    Args:
        ranges: ranges as logged [m].
        shortest: shortest range of the sensor [m].
    """
    bad = np.isnan(ranges) | (ranges < 0.0)
    return np.where(bad | (ranges < shortest), np.nan, ranges), int(bad.sum())
