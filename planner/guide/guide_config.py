"""The settings of the guide and of its path searches."""

from __future__ import annotations

from dataclasses import dataclass, field

from planner.guide.elastic_band import LineConfig
from planner.guide.hybrid_astar import HybridConfig
from planner.guide.ompl_search import PathConfig


@dataclass(frozen=True)
class GuideConfig:
    """Settings of the guide: when it plans a path, and which path it adopts.

    Attributes:
        every: number of ticks from one request for a path to the next, in normal driving.
        delay: number of ticks from a request to the adoption of its path; the search may take this
            long.
        ahead: distances along the route that OMPL's curves reach, tried in this order [m].
        better: ratio of a new path's price to the present one's below which it replaces that path.
        join: distance ahead along a prescribed route at which a path joins it [m].
        beside: distance from a prescribed route within which the car counts as following it [m].
        turning_room: distance before an obstacle at which a blocked path is cut off [m].
        leg_end: distance from a leg's end within which a car at rest has completed the leg [m].
        onward: reduction of the cost to go at which the hybrid A* search ends [m].
        search: settings of the search with OMPL.
        hybrid: settings of the hybrid A* search.
        line: settings of the smooth line.
    """

    every: int = 8
    delay: int = 1
    ahead: tuple[float, ...] = (9.0, 5.0, 3.0)
    better: float = 0.95
    join: float = 12.0
    beside: float = 1.0
    turning_room: float = 1.2
    leg_end: float = 0.12
    onward: float = 6.0
    search: PathConfig = field(default_factory=PathConfig)
    hybrid: HybridConfig = field(default_factory=HybridConfig)
    line: LineConfig = field(default_factory=LineConfig)
