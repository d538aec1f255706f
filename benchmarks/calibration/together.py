"""What several calibrations say together: pools of the same conditions, and joint certificates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby, pairwise
from typing import Any

import numpy as np

from benchmarks.calibration.certificate import absent_in
from benchmarks.calibration.learn_then_test import table
from benchmarks.runs.statistics import wilson
from foresee.infra.markdown import DASH, records
from foresee.mapping.family_names import FAMILIES
from planner.revision import FIRST
from planner.risk.betting import capital, needed

Content = dict[str, Any]
"""Contents of a calibration.json."""


def together(calibrations: Mapping[str, Content]) -> str:
    """Return the pools and the joint certificates of calibrations as Markdown; "" without any.

    Args:
        calibrations: name → contents of calibration.json. Calibrations of the same conditions are
            pooled, unless their drives may be in the same buildings: then a line says so. Those
            that differ in their buildings alone get a joint certificate.
    """
    parts = []
    names = sorted(calibrations, key=lambda name: (_alike(calibrations[name]), name))
    for _, alike in groupby(names, key=lambda name: _alike(calibrations[name])):
        by_buildings: dict[tuple[str, ...], list[str]] = {}
        for name in alike:
            by_buildings.setdefault(_buildings(calibrations[name]), []).append(name)
        for where, same in [*by_buildings.items()]:
            why = _dependent({name: calibrations[name] for name in same})
            if why:
                parts.append(f"No pool of {', '.join(same)}: {why}.")
                # Nor is there a joint certificate: none of these is the calibration of its family.
                del by_buildings[where]
            elif len(same) > 1:
                pool = pooled([calibrations[name] for name in same])
                parts.append(f"Pool of {', '.join(same)}:\n\n{table(pool)}")
        single = {where[0]: of for where, of in by_buildings.items() if len(where) == 1}
        if len(single) > 1:
            families = {
                place: pooled([calibrations[name] for name in of]) for place, of in single.items()
            }
            parts.append(f"All {len(families)} together:\n\n{records(joint(families))}")
    return "\n\n".join(parts)


def pooled(contents: Sequence[Content]) -> Content:
    """Return the calibration that the drives of several calibrations make, one after the other.

    All of them must have been made for the same conditions with the same revision of the planner,
    and their drives with other seeds: dependent drives would count twice. The gambler of
    a level goes on betting with the capital that the earlier calibration left. It depends on the
    numbers of drives and collisions, not on their order.

    Args:
        contents: contents of calibration.json of each.

    Returns:
        The contents of a calibration: what is certified, and the test of each level.
    """
    if len(contents) == 1:
        return contents[0]
    confidence = min(content["confidence"] for content in contents)
    risks = sorted({risk for content in contents for risk in _risks(content)})
    tests: dict[float, list[dict[str, Any]]] = {}
    for content in contents:
        for test in content["levels"]:
            tests.setdefault(test["level"], []).append(test)
    levels = [_sum(tests[level], risks) for level in sorted(tests)]
    generated = all(place in FAMILIES for place in _buildings(contents[0]))
    for test in levels:
        # Drives in maps are not independent, and their maps are not recorded.
        interval = wilson(test["collided"], test["drives"])
        test["nominal_interval"] = interval if generated else None
    return {
        "conditions": contents[0]["conditions"],
        "confidence": confidence,
        "certified": _certified(levels, risks, needed(confidence)),
        "levels": levels,
    }


def joint(families: Mapping[str, Content]) -> list[dict[str, Any]]:
    """Return the levels that are certified in each family alone, and in all families together.

    Each certificate is wrong with a probability of at most α = 1 - confidence, so one of n may be
    wrong with a probability of n α. With a confidence of 1 - α / n each, all hold together with a
    probability of at least 1 - α (Bonferroni): the capital must reach n / α instead of 1 / α. The
    same drives serve both, since a test may be evaluated after any drive.

    Args:
        families: family → contents of its calibration.

    Returns:
        A row for each family.
    """
    confidence = min(content["confidence"] for content in families.values())
    each = 1.0 - (1.0 - confidence) / len(families)
    risks = sorted({risk for content in families.values() for risk in _risks(content)})
    rows = []
    for family, content in sorted(families.items()):
        alone, jointly = (
            _certified(content["levels"], risks, needed(asked)) for asked in (confidence, each)
        )
        row: dict[str, Any] = {"calibration for": f"`{family}`"}
        for risk in risks:
            key = f"{risk:g}"
            row |= {
                f"risk {key}: level alone": _number(alone.get(key)),
                f"risk {key}: all {len(families)} together": _number(jointly.get(key)),
            }
        rows.append(row)
    return rows


def _certified(
    levels: Sequence[dict[str, Any]], risks: Sequence[float], wanted: float
) -> dict[str, float]:
    """Return the largest level certified for each risk, as in calibration.json.

    Args:
        levels: test of each level, from safe to bold.
        risks: risks that are certified.
        wanted: capital that certifies a risk.
    """
    certified: dict[str, float] = {}
    for risk in risks:
        for test in levels:
            if _capital(test, risk) < wanted:
                break
            certified[f"{risk:g}"] = test["level"]
    return certified


def _capital(test: Mapping[str, Any], risk: float) -> float:
    """Return the recorded capital of a test; for a risk that was not asked for, that at its end."""
    recorded = test["capital"].get(f"{risk:g}")
    return _at_the_end(test, risk) if recorded is None else float(recorded)


def _at_the_end(test: Mapping[str, Any], risk: float) -> float:
    """Return the gambler's capital after all drives of a test."""
    losses = np.arange(test["drives"]) < test["collided"]
    return float(capital(losses, risk)[-1])


def _sum(tests: Sequence[dict[str, Any]], risks: Sequence[float]) -> dict[str, Any]:
    """Return the tests of one level as one test."""
    if len(tests) == 1:
        return dict(tests[0])
    total = {name: sum(test[name] for test in tests) for name in ("drives", "collided", "km")}
    hours = sum(test["km"] / test["speed"] for test in tests)
    test = {"level": tests[0]["level"], **total, "speed": total["km"] / hours}
    return test | {"capital": {f"{risk:g}": _at_the_end(test, risk) for risk in risks}}


def _risks(content: Content) -> list[float]:
    """Return the risks that a calibration tested."""
    return sorted({float(risk) for test in content["levels"] for risk in test["capital"]})


def _buildings(content: Content) -> tuple[str, ...]:
    return tuple(sorted(content["conditions"]["world"]))


def _alike(content: Content) -> str:
    """Return the revision and the conditions of a calibration without its buildings, as text."""
    conditions = absent_in(content["conditions"]) | content["conditions"]
    kept = sorted((name, str(of)) for name, of in conditions.items() if name != "world")
    return str((content.get("revision", FIRST), kept))


def _dependent(contents: Mapping[str, Content]) -> str:
    """Return why calibrations in the same kinds of buildings are not pooled; "" if they may be."""
    if len(contents) < 2:
        return ""
    unknown = [name for name, content in contents.items() if content.get("seed") is None]
    if unknown:
        return f"{', '.join(unknown)} does not name its seed, so that buildings may be the same"
    ranges = []
    for name, content in contents.items():
        driven = max((test["drives"] for test in content["levels"]), default=0)
        # Buildings without a task have used their seed as well. Older files do not name this.
        used = max(driven, content.get("most_drives", 0))
        ranges.append((content["seed"], content["seed"] + used, name))
    ranges.sort()
    for (_, end, first), (start, _, second) in pairwise(ranges):
        if start < end:
            return (
                f"drives of {first} and of {second} may have the same seeds, from {start}; "
                "the drives of a pool must be independent"
            )
    return ""


def _number(level: float | None) -> str:
    return DASH if level is None else f"{level:g}"
