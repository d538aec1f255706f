"""Suites: sets of tasks that never change, so that drives of different people can be compared.

The file of a suite in `sim/suites` names its buildings by family and seed, each with a hash of its
true map. A building that the generators of this version draw otherwise is refused.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np

from foresee.infra.errors import LineError
from foresee.infra.plain_json import loads
from foresee.mapping.car_limits import CarLimits
from sim.buildings import map_hash, task_in_world
from sim.families import generate
from sim.task import NoTaskError, Task

FOLDER = Path(__file__).with_name("suites")
"""Folder of the suites' files, NAME.json."""
SMALL = 12
"""Number of buildings of the small size."""
TOLERANCE = 1e-3
"""Largest difference of a start, a goal or a length of a route from the suite's file [m, rad]."""


class SuiteError(LineError):
    """There is no such suite, or a building is not its own; the message is one line."""


@dataclass(frozen=True)
class Place:
    """One building of a suite, and the task in it.

    Attributes:
        family: family of the generated building.
        seed: seed of the building, and of its task.
        map: hash of the true map, see `sim.buildings.map_hash`.
        start: x, y, yaw at the start [m, m, rad].
        goal: x, y of the goal [m].
        length: length of the route [m].
    """

    family: str
    seed: int
    map: str
    start: tuple[float, ...]
    goal: tuple[float, ...]
    length: float

    @classmethod
    def of(cls, family: str, seed: int, car: CarLimits) -> tuple[Self, Task]:
        """Generate a building, and draw its task.

        Raises:
            NoTaskError: if the building has no route of at least 10 m.
        """
        task = task_in_world(generate(family, seed), seed, car)
        # Rounded, since the last digits may depend on the processor.
        start, goal = (tuple(round(float(v), 6) for v in end) for end in (task.start, task.goal))
        digest = map_hash(task.world.grid)
        return cls(family, seed, digest, start, goal, round(task.path_length, 6)), task

    def changes(self, other: Place) -> list[str]:
        """Return the names of what differs in another place by more than rounding."""
        numbers = ("start", "goal", "length")
        far = [
            name
            for name in numbers
            if not np.allclose(getattr(self, name), getattr(other, name), rtol=0, atol=TOLERANCE)
        ]
        plain = ("family", "seed", "map")
        return [name for name in plain if getattr(self, name) != getattr(other, name)] + far


@dataclass(frozen=True)
class Suite:
    """A set of tasks that never changes.

    Attributes:
        name: name with a version, such as "corridor-v1".
        route: "fixed": a driver is told the route; "free": it finds its own way.
        window: side of the square around the car in which the LIDAR is used [m].
        v_max: top speed of the car [m/s].
        reverse: top speed of the car in reverse [m/s]; 0: it has no reverse gear.
        places: the buildings, in the order in which they are driven.
        digest: hash of the suite's file.
    """

    name: str
    route: str
    window: float
    v_max: float
    reverse: float
    places: tuple[Place, ...]
    digest: str

    @classmethod
    def read(cls, name: str) -> Self:
        """Read a suite of `suites`.

        Raises:
            SuiteError: if there is none of this name.
        """
        if name not in suites():
            raise SuiteError(f"no suite is called {name!r}; there are {', '.join(suites())}")
        data = (FOLDER / f"{name}.json").read_bytes()
        content: dict[str, Any] = loads(data)
        places = tuple(
            Place(**place | {"start": tuple(place["start"]), "goal": tuple(place["goal"])})
            for place in content.pop("places")
        )
        return cls(name, **content, places=places, digest=hashlib.sha256(data).hexdigest()[:32])

    @cached_property
    def car(self) -> CarLimits:
        """The car that drives."""
        return CarLimits(v_max=self.v_max, reverse=self.reverse)

    def count(self, size: str) -> int:
        """Return the number of buildings of a size: "small", its first `SMALL`, or "full"."""
        return SMALL if size == "small" else len(self.places)

    def task(self, index: int) -> Task:
        """Return the task in a building, after a check that it is the one of the suite.

        Raises:
            SuiteError: if there is no such building, or this version draws another one or another
                task.
        """
        if not 0 <= index < len(self.places):
            raise SuiteError(
                f"suite {self.name} has no building {index}, only 0 to {len(self.places) - 1}"
            )
        wanted = self.places[index]
        what = f"suite {self.name}, building {index} ({wanted.family}, seed {wanted.seed})"
        try:
            place, task = Place.of(wanted.family, wanted.seed, self.car)
        except NoTaskError as error:
            raise SuiteError(f"{what}: this version of foresee draws no task: {error}") from None
        changed = place.changes(wanted)
        if changed:
            raise SuiteError(
                f"{what}: this version of foresee draws another {', '.join(changed)} than the "
                "suite has. Drive with a version that draws the same"
            )
        return task


def suites() -> tuple[str, ...]:
    """Return the names of the suites, sorted."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.json")))
