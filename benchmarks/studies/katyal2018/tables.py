"""The tables of an evaluation in Markdown, with the paper's values beside them."""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce
from typing import Any

from benchmarks.studies.katyal2018.contestants import BASELINES
from foresee.infra.markdown import DASH, interval, markdown
from predictor.networks import PAPER

Rows = dict[str, dict[str, Any]]
"""Predictor → measures."""
IMAGES = {
    "ssim": "SSIM of the whole square",
    "ssim_kept": "SSIM of the whole square, observed cells restored",
    "ssim_unseen": "SSIM of the unobserved cells outside the crop",
    "ssim_coarse": "SSIM, coarser with the distance from the crop",
    "ssim_coarse_unseen": "SSIM, coarser with the distance, of the unobserved cells",
}
CELLS = (
    "iou_free",
    "iou_occupied",
    "auc_free",
    "auc_occupied",
    "brier",
    "nll",
    "ece_free",
    "ece_occupied",
    "ece",
)

SHORT = {
    "ssim": "SSIM",
    "ssim_unseen": "of unobserved cells",
    "brier": "Brier",
    "ece_free": "calibration error of free",
}
"""Measures of the short table → column heads."""

ABOVE = """\
## Above the baselines

Differences in SSIM to the baselines: of the best of the paper's networks at each expansion, by SSIM
of the whole square, and of the `compact…` networks, whose input also has the cells outside the crop
that were observed. 95 % intervals over drives (simulated) and blocks of {block:g} m (physical).
"""
BEST = "the paper's best"
"""Name in tables for the best of the paper's networks, which depends on site and expansion."""
SITES = """
## Sites above the baselines

Number of sites, of {count}, at which the SSIM is significantly above that of the others: the
interval of each difference lies above zero. By expansion: {expansions}.
"""


def summary(results: dict[str, Any]) -> str:
    """Return the tables of the comparison with the baselines, and of the networks."""
    places, sites = split_places(results), results["physical"]
    expansions = list(dict.fromkeys(x for entry in places.values() for x in entry))
    return "\n".join(
        (
            ABOVE.format(block=results["settings"]["block"]),
            _verdicts(places),
            SITES.format(count=len(sites), expansions=" / ".join(expansions)),
            _sites(sites, expansions),
            "\n## The networks\n",
            _trainings(results["predictors"]),
            "\n## Cost of the paper's networks at full size\n",
            _published(results["published"]),
        )
    )


def study_tables(results: dict[str, Any]) -> str:
    """Return all tables of a results.json of `benchmarks.studies.katyal2018`."""
    parts = [summary(results)]
    for place, entry in split_places(results).items():
        published = results["paper"][drive_kind(place)]
        paper = {expansion: published.get(expansion) for expansion in entry}
        networks = predictor_names(published)
        parts.append(f"\n## {place}\n\n{_size(entry)} Expansions: {', '.join(entry)}.")
        parts.append(f"\n### In short\n\n{_in_short(entry, paper, networks)}")
        names = predictor_names(entry)
        for measure, title in IMAGES.items():
            table = _by_expansion(entry, names, measure)
            for name in networks if measure == "ssim" else ():
                values = map(_cell, _along(paper, name))
                table.append([f"the paper's {name}, on its own data", *values])
            parts.append(f"\n### {title}\n\n{markdown(table)}")
        for measure in ("ssim", "ssim_kept", "ssim_unseen"):
            for other in (*BASELINES, *({"unet_ff"} & set(names))):
                rest = [name for name in names if name != other]
                table = _by_expansion(entry, rest, "above", other, measure)
                title = f"{IMAGES[measure]}: difference to `{other}`"
                parts.append(f"\n### {title}\n\n{markdown(table)}")
        for expansion, rows in entry.items():
            parts.append(f"\n### Unobserved cells, {expansion}×\n\n{_cells(rows)}")
    parts += ["\n## Transients\n", _transients(results["transients"])]
    return "\n".join(parts) + "\n"


def split_places(results: dict[str, Any]) -> dict[str, dict[str, Rows]]:
    """Return place → expansion → predictor → measures, "simulated" first if it was scored."""
    simulated = {"simulated": results["simulated"]} if results["simulated"] else {}
    return simulated | results["physical"]


def drive_kind(place: str) -> str:
    """Return the kind of drives of a place, "simulated" or "physical"."""
    return "simulated" if place == "simulated" else "physical"


def predictor_names(entry: dict[str, Rows]) -> list[str]:
    """Return the names of the predictors of a place, each once."""
    return list(dict.fromkeys(name for rows in entry.values() for name in rows))


def _along(entry: dict[str, Any], *keys: str) -> list[Any]:
    """Return the value under these keys at each expansion; None where a key is missing."""
    return [reduce(lambda value, key: (value or {}).get(key), keys, at) for at in entry.values()]


def _in_short(entry: dict[str, Rows], paper: dict[str, Any], networks: list[str]) -> str:
    """Return a row for each predictor with its measures at all expansions side by side."""

    def side_by_side(values: list[float | None]) -> str:
        return " / ".join(_number(value).removeprefix("0") for value in values)

    rows = [["predictor", *SHORT.values(), "ms"]]
    for name in predictor_names(entry):
        cells = [side_by_side(_along(entry, name, measure)) for measure in SHORT]
        taken = [ms for ms in _along(entry, name, "cost", "ms_median") if ms is not None]
        rows.append([f"`{name}`", *cells, _number(max(taken), ".1f") if taken else ""])
    for name in networks:
        rows.append([f"{name} as published", side_by_side(_along(paper, name)), *[""] * len(SHORT)])
    return markdown(rows)


def _size(entry: dict[str, Rows]) -> str:
    """Return the number of frames and drives as a sentence."""
    row = next(iter(next(iter(entry.values())).values()))
    return f"{row['frames']} frames of {row['drives']} drive{'s' * (row['drives'] > 1)}."


def _best(measured: Rows) -> str | None:
    """Return the best of the paper's networks by SSIM; None if none was compared."""
    networks = [name for name in measured if name in PAPER]
    return max(networks, key=lambda name: measured[name]["ssim"]) if networks else None


def _compacts(measured: Iterable[str]) -> list[str]:
    """Return the variants of compact among some predictors."""
    return [name for name in measured if name.startswith("compact")]


def _sites(sites: dict[str, dict[str, Rows]], expansions: list[str]) -> str:
    """Count the sites where a predictor is above others, at each expansion."""
    entries = list(sites.values())
    names = [name for entry in entries for name in _compacts(predictor_names(entry))]
    rows = [["predictor", "above", "whole square", "unobserved cells"]]
    for name in dict.fromkeys([BEST, *names]):
        for others in (BASELINES, ("none",)):
            row = [name if name == BEST else f"`{name}`", " and ".join(f"`{o}`" for o in others)]
            for measure in ("ssim", "ssim_unseen"):
                counts = [
                    sum(_is_above(entry.get(x, {}), name, others, measure) for entry in entries)
                    for x in expansions
                ]
                row.append(" / ".join(map(str, counts)))
            rows.append(row)
    return markdown(rows)


def _is_above(measured: Rows, name: str, others: tuple[str, ...], measure: str) -> bool:
    """Return whether a predictor is above all others: the interval lies above zero."""
    chosen = _best(measured) if name == BEST else name
    above = measured[chosen]["above"] if chosen in measured else {}
    differences = [above.get(other, {}).get(measure) for other in others]
    # A single block has no interval, so no difference is statistically significant.
    return all(value is not None and (value["low"] or 0.0) > 0.0 for value in differences)


def _verdicts(places: dict[str, dict[str, Rows]]) -> str:
    """Return the differences of the best network and of compact to the baselines."""
    measures = {"ssim": "whole", "ssim_kept": "restored", "ssim_unseen": "unobserved"}
    columns = [f"{what} to `{other}`" for what in measures.values() for other in BASELINES]
    rows = [["where", "expansion", "network", "SSIM", *columns]]
    for place, entry in places.items():
        for expansion, measured in entry.items():
            best = _best(measured)
            for name in (best, *_compacts(measured)) if best else ():
                row = measured[name]
                above = [row["above"][other][what] for what in measures for other in BASELINES]
                ssim = _number(row["ssim"])
                rows.append([place, expansion, f"`{name}`", ssim, *map(_cell, above)])
    return markdown(rows) if len(rows) > 1 else "None of the paper's networks was asked."


def _trainings(predictors: dict[str, Any]) -> str:
    """Return the settings in which the training of each network differs from the paper's."""
    rows = [["network", "expansion", "other than the paper's", "fingerprint"]]
    for name, entry in predictors.items():
        for expansion, facts in entry.items():
            if isinstance(facts, dict) and "reduced" in facts:
                other = (facts["reduced"] or {}).items()
                settings = ", ".join(f"{key} {value}" for key, value in other) or "as published"
                rows.append([f"`{name}`", expansion, settings, facts["fingerprint"][:12]])
    return markdown(rows) if len(rows) > 1 else "None."


def _published(costs: dict[str, Any]) -> str:
    """Return the cost of the networks in the paper's size."""
    rows = [["network", "parameters", "multiply-adds [M]", "median [ms]", "most [ms]"]]
    rows += [[f"`{name}`", *_cost(cost, "ms_most")] for name, cost in costs.items()]
    return markdown(rows)


def _cost(cost: dict[str, Any], longest: str) -> list[str]:
    """Return the cells of a cost: parameters, multiply-adds, median and longest time."""
    macs = cost.get("macs")
    return [
        _number(cost.get("parameters"), ",d"),
        _number(None if macs is None else macs / 1e6, ",.0f"),
        _number(cost.get("ms_median"), ".1f"),
        _number(cost.get(longest), ".1f"),
    ]


def _transients(places: dict[str, Any]) -> str:
    """Return the shares of transients that networks filter."""
    columns = ("cells", "filtered", "free_without", "wall_cells", "walls_kept")
    rows = [["where", "expansion", "network", *(name.replace("_", " ") for name in columns)]]
    for place, entry in places.items():
        for expansion, measured in entry.items():
            for name, shares in measured.items():
                cells = [_number(shares[of], ",d" if "cells" in of else ".3f") for of in columns]
                rows.append([place, expansion, f"`{name}`", *cells])
    return markdown(rows) if len(rows) > 1 else "No network was asked."


def _by_expansion(entry: dict[str, Rows], names: Iterable[str], *keys: str) -> list[list[str]]:
    """Return the rows of a table of the values under some keys: predictors × expansions."""
    rows = [["predictor", *(f"{expansion}×" for expansion in entry)]]
    for name in names:
        rows.append([f"`{name}`", *map(_cell, _along(entry, name, *keys))])
        if len(keys) == 1 and any(_along(entry, name, "test")):
            values = map(_cell, _along(entry, name, "test", *keys))
            rows.append([f"`{name}`, the paper's two test drives alone", *values])
    return rows


def _cells(measured: Rows) -> str:
    """Return the scores of unobserved cells and the costs; and which predictors gave NaN."""
    cost = ("parameters", "multiply-adds [M]", "median [ms]", "99 % [ms]")
    rows = [["predictor", *(name.replace("_", " ") for name in CELLS), *cost]]
    for name, row in measured.items():
        scores = (_number(row.get(column)) for column in CELLS)
        rows.append([f"`{name}`", *scores, *_cost(row["cost"] or {}, "ms_p99")])
    notes = "".join(
        f"\n\nNote: {row['nan_cells']:,d} cells that `{name}` said were NaN, and count as not known"
        for name, row in measured.items()
        if row["nan_cells"]
    )
    return markdown(rows) + notes


def _number(value: float | None, form: str = ".3f") -> str:
    return DASH if value is None else format(value, form)


def _cell(value: dict[str, Any] | float | None) -> str:
    """Return a number, or a difference and its interval if there is one."""
    if not isinstance(value, dict):
        return _number(value)
    return _number(value["value"], "+.3f") if value["low"] is None else interval(value, "+.3f")
