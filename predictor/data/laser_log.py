"""What a real robot's log comes down to: scans, and from where each was taken."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from predictor.infra.errors import LineError
from predictor.mapping.scan import Scan

FARTHEST = 1e7
"""From the origin of a map [m]: what lies beyond is no place."""


class LogError(LineError):
    """A log cannot be read; the message is one line."""


@dataclass(frozen=True, eq=False)
class LaserLog:
    """Scans of a planar LIDAR, and the corrected pose of each.

    Attributes:
        name: of the site.
        scans: in the order in which they were taken; no longer range than the sensor's own counts.
        poses: x, y [m], yaw [rad] of the sensor at each scan, (n, 3).
        times: of the scans [s], (n,), or None where the log's clock is of no use.
        skipped: what was passed over, and how often: "bad ranges" (not a number, or negative),
            "scans without a pose".
    """

    name: str
    scans: tuple[Scan, ...]
    poses: NDArray[np.float64]
    times: NDArray[np.float64] | None
    skipped: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.scans:
            raise LogError(f"{self.name} holds no scan")
        if self.poses.shape != (len(self.scans), 3) or not np.isfinite(self.poses).all():
            raise LogError(f"{self.name}: each scan needs a pose of three finite numbers")
        if np.abs(self.poses[:, :2]).max() > FARTHEST:
            raise LogError(f"{self.name}: a pose lies {np.abs(self.poses[:, :2]).max():.3g} m from "
                           f"the origin, more than {FARTHEST:g} m")  # fmt: skip

    def __len__(self) -> int:
        return len(self.scans)


def cleaned(ranges: NDArray[np.float64], shortest: float) -> tuple[NDArray[np.float64], int]:
    """Ranges as `Scan` wants them, and how many of them were bad.

    Bad ones, NaN or negative, say nothing (NaN); neither do those below the sensor's shortest. What
    one at or above its longest says is the reader's to decide.

    Args:
        ranges: as they were logged [m].
        shortest: that the sensor measures [m].
    """
    bad = np.isnan(ranges) | (ranges < 0.0)
    return np.where(bad | (ranges < shortest), np.nan, ranges), int(bad.sum())
