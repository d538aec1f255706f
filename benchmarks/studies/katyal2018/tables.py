"""The tables of an evaluation in Markdown, with the paper's values beside them."""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce
from typing import Any

import numpy as np

from benchmarks.studies.katyal2018.contestants import BASELINES
from foresee.infra.markdown import DASH, interval, markdown
from foresee.statistics import holm, of_percentiles
from predictor.networks import PROPOSED

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
# Results: all tables of the study of predictions

## Above the baselines

Differences in SSIM to the baselines, of the paper's networks and of the `compact…` networks, whose
input also has the cells outside the crop that were observed. 95 % intervals over drives (simulated)
and blocks of {block:g} m (physical), each for a single comparison. An asterisk marks differences
that are significant at 5 % after Holm's correction for the number of comparisons in the table.
"""
AGAINST = """
## The paper's networks against its U-Net

Differences in SSIM, with intervals and asterisks as above.
"""
SITES = """
## Sites above and below the baselines

Number of sites, of {count}, at which the SSIM is significantly above that of all the others, and
at which it is significantly below: each difference is significant at 5 % after Holm's correction
for the number of comparisons in the table. By expansion: {expansions}.
"""
SIGNIFICANT = 0.05
"""Largest corrected p value of a significant difference."""
Difference = dict[str, Any]
"""A difference with its interval and p value, as of `foresee.statistics.grouped_mean`."""


def summary(results: dict[str, Any]) -> str:
    """Return the tables of the comparison with the baselines, and of the networks."""
    places, sites = split_places(results), results["physical"]
    expansions = list(dict.fromkeys(x for entry in places.values() for x in entry))
    return "\n".join(
        (
            ABOVE.format(block=results["settings"]["block"]),
            _baselines_table(places),
            AGAINST,
            _against_unet(places),
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


def _compacts(measured: Iterable[str]) -> list[str]:
    """Return the variants of compact among some predictors."""
    return [name for name in measured if name.startswith("compact")]


def _compared(measured: Iterable[str]) -> list[str]:
    """Return the paper's networks and the variants of compact among some predictors."""
    names = list(measured)
    return [*(name for name in PROPOSED if name in names), *_compacts(names)]


def _difference(measured: Rows, name: str, other: str, measure: str) -> Difference | None:
    """Return the difference of a predictor to another one; None if it is not known.

    The intervals of results without p values are percentiles of a bootstrap.
    """
    found: Difference | None = measured.get(name, {}).get("above", {}).get(other, {}).get(measure)
    if found is None or "p" in found:
        return found
    return of_percentiles(found, found["groups"])


def _significant(differences: Iterable[Difference | None]) -> list[int]:
    """Return the sign of each difference that is significant among all of them, else 0."""
    every = list(differences)
    p_values = [d["p"] if d and d["p"] is not None else 1.0 for d in every]
    corrected = holm(p_values)
    return [
        int(np.sign(d["value"])) if d and p < SIGNIFICANT else 0
        for d, p in zip(every, corrected, strict=True)
    ]


def _marked(rows: list[list[str | Difference | None]]) -> list[list[str]]:
    """Return cells as text, with an asterisk after each difference that is significant."""
    differences = [cell for row in rows for cell in row if not isinstance(cell, str)]
    signs = iter(_significant(differences))
    return [
        [cell if isinstance(cell, str) else _cell(cell) + " *" * abs(next(signs)) for cell in row]
        for row in rows
    ]


def _baselines_table(places: dict[str, dict[str, Rows]]) -> str:
    """Return the differences of the paper's networks and of compact to the baselines."""
    measures = {"ssim": "whole", "ssim_kept": "restored", "ssim_unseen": "unobserved"}
    pairs = [(measure, other) for measure in measures for other in BASELINES]
    columns = [f"{measures[measure]} to `{other}`" for measure, other in pairs]
    rows: list[list[str | Difference | None]] = [
        [place, expansion, f"`{name}`", _number(measured[name]["ssim"])]
        + [_difference(measured, name, other, measure) for measure, other in pairs]
        for place, entry in places.items()
        for expansion, measured in entry.items()
        for name in _compared(measured)
    ]
    return markdown([["where", "expansion", "network", "SSIM", *columns], *_marked(rows)])


def _against_unet(places: dict[str, dict[str, Rows]]) -> str:
    """Return the differences of the paper's other networks to its U-Net."""
    unet, *others = PROPOSED
    pairs = [(name, measure) for name in others for measure in ("ssim", "ssim_unseen")]
    what = {"ssim": "whole", "ssim_unseen": "unobserved"}
    rows: list[list[str | Difference | None]] = [
        [place, expansion] + [_difference(measured, name, unet, measure) for name, measure in pairs]
        for place, entry in places.items()
        for expansion, measured in entry.items()
    ]
    heads = [f"`{name}`, {what[measure]}" for name, measure in pairs]
    return markdown([["where", "expansion", *heads], *_marked(rows)])


def _sites(sites: dict[str, dict[str, Rows]], expansions: list[str]) -> str:
    """Count the sites where a predictor is above or below others, at each expansion."""
    entries = list(sites.values())
    every = (name for entry in entries for name in _compared(predictor_names(entry)))
    kinds = [
        (name, others, measure)
        for name in dict.fromkeys(every)
        for others in (BASELINES, ("none",))
        for measure in ("ssim", "ssim_unseen")
    ]
    keys = [
        (name, other, measure, x, site)
        for name, others, measure in kinds
        for other in others
        for x in expansions
        for site in range(len(entries))
    ]
    differences = (
        _difference(entries[site].get(x, {}), name, other, measure)
        for name, other, measure, x, site in keys
    )
    signs = dict(zip(keys, _significant(differences), strict=True))

    def counts(name: str, others: tuple[str, ...], measure: str, sign: int) -> str:
        return " / ".join(
            str(
                sum(
                    all(signs[name, other, measure, x, site] == sign for other in others)
                    for site in range(len(entries))
                )
            )
            for x in expansions
        )

    heads = ("whole square: above", "below", "unobserved cells: above", "below")
    rows = [["predictor", "others", *heads]]
    for name, others in dict.fromkeys((name, others) for name, others, _ in kinds):
        row = [f"`{name}`", " and ".join(f"`{other}`" for other in others)]
        row += [
            counts(name, others, measure, sign)
            for measure in ("ssim", "ssim_unseen")
            for sign in (1, -1)
        ]
        rows.append(row)
    return markdown(rows)


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
    if "p" not in value:
        value = of_percentiles(value, value["groups"])
    return _number(value["value"], "+.3f") if value["low"] is None else interval(value, "+.3f")
