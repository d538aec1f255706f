"""The result of one drive, as it is stored in results.json and used by tables and figures."""

from __future__ import annotations

from dataclasses import MISSING, dataclass, fields
from functools import cache
from typing import Any, Self, get_type_hints

from foresee.infra.plain_json import fits
from foresee.mapping.conventions import GOAL_RADIUS
from planner.revision import FIRST

SIZES = {"start": 3, "goal": 2, "cycle_ms": 2}
"""Field that is a list → its length."""


@dataclass(frozen=True, kw_only=True)
class DriveResult:
    """The measures of one drive; `dataclasses.asdict` gives its entry in results.json.

    Fields with a default are missing in the results of older versions.

    Attributes:
        vehicle: kind of car, one of `benchmarks.runs.settings.VEHICLES`.
        t_opt: time of the fastest drive that `benchmarks.optimum` found for the task [s].
        arm: arm, a key of `benchmarks.runs.arms.ARMS`, with its risk if that is above 0, as in
            "predicted 2 %".
        index: number of the episode.
        world: name of the building.
        seed: seed of the task.
        start: x [m], y [m], yaw [rad] of the start.
        goal: x, y of the goal [m].
        goal_radius: distance from the goal within which it is reached [m].
        time_limit: time limit that the task gives [s]; None: it gives none.
        top_speed: top speed that the task allows [m/s]; None: that of the car.
        score_speed: speed at which the shortest path takes T* [m/s]; None: there is no T*.
        published_length: length of the shortest path that the task gives [m].
        learned: whether a predictor of the arm was trained or validated in this building.
        shortest: length of the task's prescribed route [m].
        outcome: outcome, one of `sim.episode.Outcome`.
        time: duration [s].
        path_length: distance driven [m].
        shortest_length: length of the shortest path with the whole map known [m]; None if no path
            was found.
        t_bound: least time T_bound for the shortest path at the car's limits [s].
        sct: success weighted by completion time, t_bound / time; 0 if the goal was not reached.
        detour: path_length / shortest_length.
        mean_speed: mean speed [m/s].
        max_speed: highest speed [m/s].
        min_clearance: smallest distance of the body from an obstacle, see `sim.episode.Episode`
            [m].
        stops: number of stops before the end.
        hard_stops: number of these that were hard, see `sim.episode.Episode`.
        impact_speed: speed at the collision [m/s]; None if there was none.
        promises: number of ticks in which the plan relied on unobserved cells.
        promises_broken: number of these ticks in which such a cell was in fact not free.
        ticks: number of control cycles.
        faults: kind of fault → number of ticks in which it was handled.
        paths: source of the path → number of paths followed.
        commit: commit of the code that drove.
        revision: revision of the driving, see `planner.revision`.
        level: level λ of the last resort at the start, of an arm that takes the chosen risk.
        uncertified: whether the level is not certified for these drives.
        calibrated: revision that the calibration was measured with which gave the level of the last
            resort; None: none did.
        late_ticks: number of ticks whose control was late; None: the drive was not on the wall
            clock.
        late_predictions: number of ticks whose prediction was late; None: there was no deadline.
        cycle_ms: median and 99th percentile of the time of a control cycle [ms].
    """

    vehicle: str = "dubins"
    t_opt: float | None = None
    arm: str
    index: int
    world: str
    seed: int
    start: list[float]
    goal: list[float]
    goal_radius: float = GOAL_RADIUS
    time_limit: float | None = None
    top_speed: float | None = None
    score_speed: float | None = None
    published_length: float | None = None
    learned: bool
    shortest: float
    outcome: str
    time: float
    path_length: float
    shortest_length: float | None = None
    t_bound: float | None = None
    sct: float | None = None
    detour: float | None = None
    mean_speed: float
    max_speed: float
    min_clearance: float
    stops: int
    hard_stops: int | None = None
    impact_speed: float | None
    promises: int
    promises_broken: int
    ticks: int
    faults: dict[str, int]
    paths: dict[str, int]
    commit: str | None
    revision: int = FIRST
    level: float | None = None
    uncertified: bool = False
    calibrated: int | None = None
    late_ticks: int | None = None
    late_predictions: int | None = None
    cycle_ms: list[float]

    @classmethod
    def from_json(cls, entry: Any) -> Self:
        """Return the result that a JSON object contains; unknown names are ignored.

        Raises:
            ValueError: if a field is missing, of the wrong type, or not a finite number.
        """
        if not isinstance(entry, dict):
            raise ValueError("the result of a drive must be an object")
        hints = _hints()
        known = {name: entry[name] for name in hints if name in entry}
        wrong = [name for name, value in known.items() if not fits(value, hints[name])]
        required = {field.name for field in fields(cls) if field.default is MISSING}
        wrong += sorted(required - known.keys())
        wrong += [name for name, n in SIZES.items() if name not in wrong and len(known[name]) != n]
        # The name of an arm is part of a file's name.
        if not wrong and ("/" in known["arm"] or "\0" in known["arm"]):
            wrong = ["arm"]
        if wrong:
            raise ValueError(f"the result of a drive lacks a proper {wrong[0]}")
        return cls(**known)

    @property
    def earlier_calibration(self) -> bool:
        """Whether the calibration was measured with an earlier revision of the driving."""
        return self.calibrated is not None and self.calibrated < self.revision

    @property
    def t_star(self) -> float | None:
        """Time T* of the shortest path, which the BARN score compares with [s]; None: unknown."""
        length = self.published_length or self.shortest_length
        return None if length is None or self.score_speed is None else length / self.score_speed

    @property
    def verdict(self) -> str:
        """The time and, if it is known, the SCT as text for figures."""
        return f"{self.time:.1f} s" + ("" if self.sct is None else f" · SCT {self.sct:.2f}")


@cache
def _hints() -> dict[str, Any]:
    return get_type_hints(DriveResult)
