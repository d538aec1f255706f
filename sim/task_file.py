"""Tasks as a file: start, goal and rules of drives in maps, as JSON.

docs/reference/maps.md describes the format.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from reprlib import repr as short
from typing import Any

import numpy as np

from foresee.infra.errors import LineError, one_line
from foresee.infra.input_file import read_input
from foresee.infra.plain_json import fits, loads
from foresee.mapping.body import Body, Scene, first_contact
from foresee.mapping.conventions import GOAL_RADIUS
from sim.task import Rules
from sim.world import World

MOST_BYTES = 10_000_000
"""Largest file that is read [bytes]: that of some 50 000 tasks."""
TASKS = "tasks"
"""Field with the list of tasks."""
COORDINATES = {"start": "[x, y, yaw] in m and rad", "goal": "[x, y] in m"}
"""Required field of a task → its form."""
RULES = {
    # The planner aims at a smaller distance, see planner/motion/goal.py.
    "goal_radius_m": ("goal_radius", GOAL_RADIUS, 100.0),
    "time_limit_s": ("time_limit", 1.0, 36_000.0),
    "top_speed_m_s": ("top_speed", 0.5, 10.0),
    "score_speed_m_s": ("score_speed", 0.01, 100.0),
    "path_length_m": ("published_length", 0.1, 1e6),
}
"""Optional field of a task → field of `Rules`, and smallest and largest value."""
FIELDS = ("map", *COORDINATES, *RULES)


class TaskFileError(LineError):
    """A given task or a file of tasks cannot be used; the message is one line that says why."""


@dataclass(frozen=True)
class GivenTask:
    """A task that was not drawn.

    Attributes:
        map: name of its map; None: that of the only map.
        start: x, y, yaw at the start [m, m, rad].
        goal: x, y of the goal [m].
        rules: when a drive ends, how fast the car may be, and what its time is compared with.

    Raises:
        TaskFileError: if it starts within the goal's radius.
    """

    map: str | None
    start: tuple[float, float, float]
    goal: tuple[float, float]
    rules: Rules

    def __post_init__(self) -> None:
        if math.dist(self.start[:2], self.goal) <= self.rules.goal_radius:
            raise TaskFileError(
                f"start {list(self.start)} lies within {self.rules.goal_radius:g} m of the goal "
                f"{list(self.goal)}, where the drive ends"
            )

    def check_ends(self, world: World, body: Body) -> None:
        """Check that the car fits at the start, and that the goal is free.

        Args:
            world: the task's map.
            body: body of the car.

        Raises:
            TaskFileError: if not.
        """
        frame = world.grid.frame
        scene = Scene(world.solid, *frame.lattice, *body.halves)
        if first_contact(scene, np.array([self.start])) >= 0:
            raise TaskFileError(
                f"start {list(self.start)} in {world.name}: there the car's body is in a wall, in "
                "unknown space or outside of the map"
            )
        inside, rows, cols = frame.locate(np.array([self.goal]))
        if not inside.all() or world.solid[rows, cols].any():
            raise TaskFileError(
                f"goal {list(self.goal)} in {world.name} is in a wall, in unknown space or outside "
                "of the map"
            )


@dataclass(frozen=True)
class TaskFile:
    """The tasks of a file.

    Attributes:
        digest: hash of the file.
        tasks: its tasks, at least one.
    """

    digest: str
    tasks: tuple[GivenTask, ...]

    @classmethod
    def read(cls, path: Path) -> TaskFile:
        """Read and check a file of tasks; whether they fit to their maps is not checked.

        Raises:
            TaskFileError: if it cannot be read, or breaks a rule of the format.
        """
        try:
            data = read_input(path, MOST_BYTES)
            tasks = tuple(_tasks(loads(data, unique=True)))
        except (OSError, ValueError) as error:
            why = str(error) if isinstance(error, TaskFileError) else one_line(error)
            raise TaskFileError(f"{path} is no file of tasks: {why}") from None
        return cls(hashlib.sha256(data).hexdigest()[:32], tasks)


def _tasks(content: Any) -> Iterator[GivenTask]:
    """Yield the tasks of a file's content."""
    if not isinstance(content, dict):
        raise TaskFileError("it holds no object")
    common = {name: value for name, value in content.items() if name != TASKS}
    _refuse_unknown(common, "the file")
    # A field that is an object gives the value for each map.
    by_map = {name: value for name, value in common.items() if isinstance(value, dict)}
    maps = list(dict.fromkeys(name for values in by_map.values() for name in values))
    entries = content.get(TASKS, [{"map": name} for name in maps] or [{}])
    if not isinstance(entries, list) or not entries:
        raise TaskFileError(f"{TASKS} is {short(entries)}, it must be a list of objects")
    numbers: dict[GivenTask, int] = {}
    for number, entry in enumerate(entries):
        where = f"task {number}"
        if not isinstance(entry, dict):
            raise TaskFileError(f"{where} is {short(entry)}, it must be an object")
        _refuse_unknown(entry, where)
        name = entry.get("map", common.get("map"))
        if name is not None and not isinstance(name, str):
            raise TaskFileError(f"{where}: map is {short(name)}, it must be the name of a map")
        own = {field: values[name] for field, values in by_map.items() if name in values}
        plain = {field: value for field, value in common.items() if field not in by_map}
        task = _task(plain | own | entry, name, where if name is None else f"{where} ({name})")
        if task in numbers:
            raise TaskFileError(f"{where} is the same as task {numbers[task]}")
        numbers[task] = number
    unused = set(maps) - {task.map for task in numbers}
    if unused:
        raise TaskFileError(f"there is no task in {min(unused)}, for which a field has a value")
    yield from numbers


def _refuse_unknown(facts: Mapping[str, Any], where: str) -> None:
    unknown = [name for name in facts if name not in FIELDS]
    if unknown:
        raise TaskFileError(
            f"{where} has a field {short(unknown[0])}; there are {TASKS}, {', '.join(FIELDS)}"
        )


def _task(facts: Mapping[str, Any], name: str | None, where: str) -> GivenTask:
    """Check the fields of a task and return it."""
    for field, form in COORDINATES.items():
        if field not in facts:
            raise TaskFileError(f"{where} has no {field}, {form}")
        value = facts[field]
        if not fits(value, list[float]) or len(value) != form.count(",") + 1:
            raise TaskFileError(f"{where}: {field} is {short(value)}, it must be {form}")
    rules = dict[str, float]()
    for field, (rule, low, high) in RULES.items():
        if field in facts:
            value = facts[field]
            if not fits(value, float) or not low <= value <= high:
                raise TaskFileError(
                    f"{where}: {field} is {short(value)}, it must be a number from {low:g} to "
                    f"{high:g}"
                )
            rules[rule] = float(value)
    if "top_speed" in rules:
        rules.setdefault("score_speed", rules["top_speed"])
    x, y, yaw = map(float, facts["start"])
    goal_x, goal_y = map(float, facts["goal"])
    try:
        return GivenTask(name, (x, y, yaw), (goal_x, goal_y), Rules(**rules))
    except TaskFileError as error:
        raise TaskFileError(f"{where}: {error}") from None
