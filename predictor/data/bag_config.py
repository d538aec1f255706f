"""The topics that are read from a bag.

This module imports nothing heavy, since command lines are built from it.
"""

from __future__ import annotations

from dataclasses import dataclass

from foresee.infra.options import Options, option


@dataclass(frozen=True)
class BagConfig(Options):
    """Topics to read from a bag."""

    scans: str | None = option(None, "topic of a bag's LaserScans (default: the only one)", "TOPIC")
    poses: str | None = option(
        None,
        "topic of a bag's poses: /tf, PoseStamped, PoseWithCovarianceStamped or Odometry "
        "(default: /tf where it knows the map, else the only topic of poses)",
        "TOPIC",
    )
    map_frame: str = option("map", "map frame in /tf", "FRAME")
