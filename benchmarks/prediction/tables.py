"""The tables of an evaluation in Markdown, with the paper's values beside them."""

from __future__ import annotations

from typing import Any

from benchmarks.prediction.contestants import BASELINES
from predictor.infra.markdown import interval, markdown
from predictor.networks import ARCHITECTURES

Rows = dict[str, dict[str, Any]]
"""Predictor → measures."""
IMAGES = {
    "ssim": "SSIM of the whole square",
    "ssim_kept": "SSIM of the whole square, what was seen put back",
    "ssim_unseen": "SSIM on cells not seen, outside the crop",
    "ssim_coarse": "SSIM, coarser the farther",
    "ssim_coarse_unseen": "SSIM, coarser the farther, on cells not seen outside the crop",
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
    "ssim_unseen": "of cells not seen",
    "brier": "Brier",
    "ece_free": "calibration error of free",
}
"""Measures of the short table, and their column heads."""

ABOVE = """\
## Above the baselines

The best of the paper's networks at each expansion, by SSIM of the whole square, and those called
`compact…`, which are given what lies beyond the crop too where the car has been. Their differences
to each baseline, with 95 % intervals over drives (simulated) and blocks of {block:g} m (physical).
"""
BEST = "the paper's best"
"""Name of the paper's best network, which depends on site and expansion."""
SITES = """
## Sites above the baselines

At how many of {count} sites the SSIM is above that of the others for certain: the interval of each
difference above zero. By expansion: {expansions}.
"""


def summary(results: dict[str, Any]) -> str:
    """Return the comparison with the baselines, and the list of networks."""
    return "\n".join(
        (
            ABOVE.format(block=results["settings"]["block"]),
            _verdicts(places_of(results)),
            SITES.format(count=len(results["physical"]), expansions=" / ".join(_asked(results))),
            _sites(results["physical"], _asked(results)),
            "\n## The networks\n",
            _trainings(results["predictors"]),
            "\n## What the paper's networks cost, whole\n",
            _printed(results["printed"]),
        )
    )


def tables_of(results: dict[str, Any]) -> str:
    """Return all tables of a results.json of `benchmarks.prediction`."""
    parts = [summary(results)]
    for place, entry in places_of(results).items():
        kind = "simulated" if place == "simulated" else "physical"
        parts.append(f"\n## {place}\n\n{_size(entry)} Expansions: {', '.join(entry)}.")
        parts.append(f"\n### In short\n\n{_in_short(entry, results['paper'][kind])}")
        for measure, title in IMAGES.items():
            paper = results["paper"][kind] if measure == "ssim" else {}
            parts.append(f"\n### {title}\n\n{_by_expansion(entry, measure, paper)}")
        for measure in ("ssim", "ssim_kept", "ssim_unseen"):
            for other in (*BASELINES, *({"unet_ff"} & set(_names(entry)))):
                title = f"{IMAGES[measure]}: difference to `{other}`"
                parts.append(f"\n### {title}\n\n{_differences(entry, measure, other)}")
        for expansion, rows in entry.items():
            parts.append(f"\n### Cells not seen, {expansion}×\n\n{_cells(rows)}")
    parts += ["\n## Transients\n", _transients(results["transients"])]
    return "\n".join(parts) + "\n"


def _in_short(entry: dict[str, Rows], paper: dict[str, dict[str, float]]) -> str:
    """Return a row for each predictor with its measures at all expansions side by side."""

    def side_by_side(found: list[float | None]) -> str:
        return " / ".join(_number(value).removeprefix("0") for value in found)

    rows = [["predictor", *SHORT.values(), "ms"]]
    for name in _names(entry):
        here = [measured.get(name, {}) for measured in entry.values()]
        taken = [row["cost"]["ms_median"] for row in here if row.get("cost")]
        rows.append(
            [
                f"`{name}`",
                *(side_by_side([row.get(of) for row in here]) for of in SHORT),
                _number(max(taken), ".1f") if taken else "",
            ]
        )
    for name in dict.fromkeys(name for printed in paper.values() for name in printed):
        found = [paper.get(expansion, {}).get(name) for expansion in entry]
        rows.append([f"{name} as printed", side_by_side(found), *[""] * len(SHORT)])
    return markdown(rows)


def places_of(results: dict[str, Any]) -> dict[str, dict[str, Rows]]:
    """Return place → expansion → predictor → measures, "simulated" first if it was scored."""
    simulated = {"simulated": results["simulated"]} if results["simulated"] else {}
    return simulated | results["physical"]


def _size(entry: dict[str, Rows]) -> str:
    """Return the number of frames and drives as a sentence."""
    row = next(iter(next(iter(entry.values())).values()))
    return f"{row['frames']} frames of {row['drives']} drive{'s' * (row['drives'] > 1)}."


def _names(entry: dict[str, Rows]) -> list[str]:
    return list(dict.fromkeys(name for rows in entry.values() for name in rows))


def _asked(results: dict[str, Any]) -> list[str]:
    return list(dict.fromkeys(e for entry in places_of(results).values() for e in entry))


def _best(measured: Rows) -> str | None:
    """Return the best of the paper's networks by SSIM; None if none was compared."""
    networks = [name for name in measured if name in ARCHITECTURES]
    return max(networks, key=lambda name: measured[name]["ssim"]) if networks else None


def _compacts(measured: Rows) -> list[str]:
    return [name for name in measured if name.startswith("compact")]


def _sites(sites: dict[str, dict[str, Rows]], expansions: list[str]) -> str:
    names = [
        name for entry in sites.values() for rows in entry.values() for name in _compacts(rows)
    ]
    rows = [["predictor", "above", "whole square", "cells not seen"]]
    for name in dict.fromkeys([BEST, *names]):
        for others in (BASELINES, ("none",)):
            counts = []
            for measure in ("ssim", "ssim_unseen"):
                found = [
                    sum(
                        _is_above(entry.get(e, {}), name, others, measure)
                        for entry in sites.values()
                    )
                    for e in expansions
                ]
                counts.append(" / ".join(map(str, found)))
            rows.append(
                [
                    name if name == BEST else f"`{name}`",
                    " and ".join(f"`{other}`" for other in others),
                    *counts,
                ]
            )
    return markdown(rows)


def _is_above(measured: Rows, name: str, others: tuple[str, ...], measure: str) -> bool:
    chosen = _best(measured) if name == BEST else name
    above = measured[chosen]["above"] if chosen in measured else {}
    found = [above.get(other, {}).get(measure) for other in others]
    # A single block has no interval, so no difference is statistically significant.
    return all(difference is not None and (difference["low"] or 0.0) > 0.0 for difference in found)


def _verdicts(places: dict[str, dict[str, Rows]]) -> str:
    head = ["where", "expansion", "network", "SSIM"]
    measures = {"ssim": "whole", "ssim_kept": "seen put back", "ssim_unseen": "unseen"}
    head += [f"{what} to `{other}`" for what in measures.values() for other in BASELINES]
    rows = [head]
    for place, entry in places.items():
        for expansion, measured in entry.items():
            best = _best(measured)
            if best is None:
                continue
            for name in (best, *_compacts(measured)):
                above = measured[name]["above"]
                found = [above[other][measure] for measure in measures for other in BASELINES]
                rows.append(
                    [
                        place,
                        expansion,
                        f"`{name}`",
                        _number(measured[name]["ssim"]),
                        *map(_interval, found),
                    ]
                )
    return markdown(rows) if len(rows) > 1 else "None of the paper's networks was asked."


def _trainings(predictors: dict[str, Any]) -> str:
    rows = [["network", "expansion", "other than the paper's", "fingerprint"]]
    for name, entry in predictors.items():
        for expansion, facts in entry.items():
            if isinstance(facts, dict) and "reduced" in facts:
                other = facts["reduced"] or {}
                told = ", ".join(f"{what} {value}" for what, value in other.items())
                rows.append(
                    [f"`{name}`", expansion, told or "as printed", facts["fingerprint"][:12]]
                )
    return markdown(rows) if len(rows) > 1 else "None."


def _printed(costs: dict[str, Any]) -> str:
    rows = [["network", "parameters", "multiply-adds [M]", "median [ms]", "most [ms]"]]
    for name, cost in costs.items():
        rows.append(
            [
                f"`{name}`",
                _number(cost["parameters"], ",d"),
                _number(cost["macs"] / 1e6, ",.0f"),
                _number(cost["ms_median"], ".1f"),
                _number(cost["ms_most"], ".1f"),
            ]
        )
    return markdown(rows)


def _transients(places: dict[str, Any]) -> str:
    columns = ("cells", "filtered", "free_without", "wall_cells", "walls_kept")
    rows = [["where", "expansion", "network", *(name.replace("_", " ") for name in columns)]]
    for place, entry in places.items():
        for expansion, measured in entry.items():
            for name, shares in measured.items():
                found = [
                    _number(shares[column], ",d" if "cells" in column else ".3f")
                    for column in columns
                ]
                rows.append([place, expansion, f"`{name}`", *found])
    return markdown(rows) if len(rows) > 1 else "No network was asked."


def _by_expansion(entry: dict[str, Rows], measure: str, paper: dict[str, dict[str, float]]) -> str:
    rows = [["predictor", *(f"{expansion}×" for expansion in entry)]]
    for name in _names(entry):
        rows.append(
            [
                f"`{name}`",
                *(_number(measured.get(name, {}).get(measure)) for measured in entry.values()),
            ]
        )
        if any("test" in measured.get(name, {}) for measured in entry.values()):
            of_test = [
                measured.get(name, {}).get("test", {}).get(measure) for measured in entry.values()
            ]
            rows.append([f"`{name}`, the paper's two test drives alone", *map(_number, of_test)])
    for name in dict.fromkeys(name for printed in paper.values() for name in printed):
        found = [paper.get(expansion, {}).get(name) for expansion in entry]
        rows.append([f"the paper's {name}, on its own data", *map(_number, found)])
    return markdown(rows)


def _differences(entry: dict[str, Rows], measure: str, other: str) -> str:
    rows = [["predictor", *(f"{expansion}×" for expansion in entry)]]
    for name in _names(entry):
        if name != other:
            found = [
                measured.get(name, {}).get("above", {}).get(other, {}).get(measure)
                for measured in entry.values()
            ]
            rows.append([f"`{name}`", *map(_interval, found)])
    return markdown(rows)


def _cells(measured: Rows) -> str:
    cost = ("parameters", "multiply-adds [M]", "median [ms]", "99 % [ms]")
    rows = [["predictor", *(name.replace("_", " ") for name in CELLS), *cost]]
    for name, row in measured.items():
        of = row["cost"] or {}
        macs = of.get("macs")
        rows.append(
            [
                f"`{name}`",
                *(_number(row[column]) for column in CELLS),
                _number(of.get("parameters"), ",d"),
                _number(None if macs is None else macs / 1e6, ",.0f"),
                _number(of.get("ms_median"), ".1f"),
                _number(of.get("ms_p99"), ".1f"),
            ]
        )
    lines = markdown(rows)
    nan = {name: row["nan_cells"] for name, row in measured.items() if row["nan_cells"]}
    told = "".join(
        f"\n\nmind: {count:,d} cells that `{name}` said were NaN, and count as not known"
        for name, count in nan.items()
    )
    return lines + told


def _number(value: float | None, form: str = ".3f") -> str:
    return "–" if value is None else format(value, form)


def _interval(value: dict[str, Any] | None) -> str:
    if value is None or value["low"] is None:
        return "–" if value is None else _number(value["value"], "+.3f")
    return interval(value, "+.3f")
