"""Compare buildings by numbers: families of generated ones, and maps of real ones.

    python -m benchmarks.studies.buildings --world as_built floor_plan MAPS --out buildings.json

`sim.building_statistics` says what the numbers are. Maps are grouped by their folder. They are
brought to the resolution of the generated buildings.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from foresee.infra.command_line import Command
from foresee.infra.options import Options, option
from foresee.mapping.family_names import FAMILIES

QUANTILES = (0.25, 0.5, 0.75)
"""Quantiles over the buildings of a group that the table shows."""


@dataclass(frozen=True)
class BuildingsSettings(Options):
    """The buildings that are compared, and the file of the results."""

    world: tuple[str, ...] = option(
        ("as_built", "floor_plan", "office", "corridor"),
        "families of generated buildings, map_server .yaml files, or folders of them",
        "W",
    )
    buildings: int = option(100, "number of buildings of each family", "N", low=1, high=10**6)
    seed: int = option(0, "seed of a family's first building", "N", low=0, high=2**31)
    out: Path = option(Path("results/buildings.json"), "file of the results", "FILE")


def _run(settings: BuildingsSettings) -> None:
    # Imported here, so that --help and bad arguments do not wait for slow imports.
    import numpy as np

    from foresee.infra.environment import commit
    from foresee.infra.progress import progress
    from foresee.infra.results_file import write_results
    from predictor.evaluation.drive_scores import report_groups
    from predictor.recording.own_buildings import read_building
    from sim.building_statistics import building_statistics
    from sim.buildings import sources
    from sim.families import generate

    seeds = range(settings.seed, settings.seed + settings.buildings)
    items = [
        (place, seed)
        for place in sources(settings.world)
        for seed in (seeds if place in FAMILIES else (0,))
    ]
    names = report_groups([place for place, _ in items])
    groups: dict[str, list[dict[str, float]]] = {}
    for place, seed in progress(items, unit="building"):
        world = generate(place, seed) if place in FAMILIES else read_building(Path(place))
        numbers = building_statistics(world, np.random.default_rng(seed))
        rounded = {name: round(number, 4) for name, number in numbers.items()}
        groups.setdefault(names[place], []).append(rounded)
    results = {"commit": commit(), "seed": settings.seed, "groups": groups}
    write_results(settings.out, "buildings", results)
    print(table(results), "", settings.out, sep="\n")


def table(results: dict[str, Any]) -> str:
    """Return the median and the quartiles of each statistic as a Markdown table.

    It has a line for each statistic, and a column for each group of buildings.
    """
    import numpy as np

    from foresee.infra.markdown import markdown
    from sim.building_statistics import STATISTICS

    groups = results["groups"]
    rows = [["", *(f"`{name}`" for name in groups)]]
    rows.append(["number of buildings", *(str(len(of)) for of in groups.values())])
    for name, what in STATISTICS.items():
        row = [what]
        for of in groups.values():
            low, middle, high = np.quantile([numbers[name] for numbers in of], QUANTILES)
            row.append(f"{_short(middle)} ({_short(low)}–{_short(high)})")
        rows.append(row)
    return markdown(rows)


def _short(value: float) -> str:
    """Return a number with two decimals, or without any if it is large."""
    return f"{value:.0f}" if value >= 20 else f"{value:.2f}"


main = Command("benchmarks.studies.buildings", __doc__, _run, resumes=False)

if __name__ == "__main__":
    sys.exit(main())
