"""Draw the suites of the race, and write their files; an existing one is compared instead.

python -m benchmarks.studies.suites --out sim/suites
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from foresee.infra.atomic_file import write_whole
from foresee.infra.command_line import Command
from foresee.infra.options import Options, option

BUILDINGS = 60
"""Number of buildings of each suite."""
SEED = 900_000_000
"""Seed of the first building of the first suite. No training, calibration, tuning or published run
uses seeds from here to 910 000 000."""
APART = 1_000_000
"""Difference of the first seeds of two suites."""
PRESCRIBED = {"route": "fixed", "window": 5.0, "v_max": 4.0, "reverse": 0.0}
"""Rules of a suite with prescribed routes."""
SUITES: dict[str, tuple[tuple[str, ...], dict[str, Any]]] = {
    "corridor-v1": (("corridor",), PRESCRIBED),
    "office-v1": (("office",), PRESCRIBED),
    "floor-plans-v1": (("floor_plan",), PRESCRIBED),
    # A free route leads into dead ends, so the car has a reverse gear.
    "mixed-v1": (
        ("corridor", "office", "narrow", "floor_plan", "trap", "as_built"),
        PRESCRIBED | {"route": "free", "reverse": 0.5},
    ),
}
"""Suite → the families that take turns, and its rules. Never change one: add another version."""


@dataclass(frozen=True)
class SuiteFolder(Options):
    """Where the suites are written."""

    out: Path = option(Path("results/suites"), "folder of the files", "DIR")


def draw(name: str) -> bytes:
    """Return the content of a suite's file.

    Args:
        name: name of the suite, a key of `SUITES`.
    """
    from foresee.infra.progress import progress
    from foresee.mapping.car_limits import CarLimits
    from sim.suite import Place
    from sim.task import NoTaskError

    families, rules = SUITES[name]
    car = CarLimits(v_max=rules["v_max"], reverse=rules["reverse"])
    seed = SEED + APART * list(SUITES).index(name)
    lines: list[str] = []
    with progress(total=BUILDINGS, desc=name, unit="building") as bar:
        while len(lines) < BUILDINGS:
            family = families[len(lines) % len(families)]
            try:
                place, task = Place.of(family, seed, car)
            except NoTaskError:
                place = None
            seed += 1
            # A driver cannot tell which part of a route that passes a place twice it follows.
            if place is None or (rules["route"] == "fixed" and task.comes_back):
                continue
            lines.append(json.dumps(asdict(place)))
            bar.update()
    places = ",\n".join(lines)
    return f'{json.dumps(rules)[:-1]}, "places": [\n{places}\n]}}\n'.encode()


def _run(where: SuiteFolder) -> int:
    where.out.mkdir(parents=True, exist_ok=True)
    others = 0
    for name in SUITES:
        path, content = where.out / f"{name}.json", draw(name)
        if not path.exists():
            write_whole(path, content)
        same = path.read_bytes() == content
        others += not same
        print(f"{path}: {'as drawn' if same else 'is another than this version draws'}")
    return 1 if others else 0


main = Command("benchmarks.studies.suites", __doc__, _run, resumes=False)

if __name__ == "__main__":
    sys.exit(main())
