"""What a run comes to: a summary for machines, and a table for people."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.statistics import (
    Result,
    difference,
    mcnemar,
    paired_speed,
    realised_risk,
    share_of_gap,
    wilson,
)
from benchmarks.tables import interval, markdown

OUTCOMES = ("reached", "collided", "timed_out", "stuck")


def paired(episodes: list[Result], arms: tuple[str, ...]) -> dict[str, list[Result]]:
    """Each arm's results on the episodes that all arms have finished, in one order."""
    by_key = {(r["index"], r["arm"]): r for r in episodes}
    indices = sorted({r["index"] for r in episodes})
    common = [i for i in indices if all((i, arm) in by_key for arm in arms)]
    return {arm: [by_key[i, arm] for i in common] for arm in arms}


def summarise(episodes: list[Result], arms: tuple[str, ...]) -> dict[str, Any]:
    """arm → figures, over the paired episodes; {} while no episode is finished by all arms."""
    by_arm = paired(episodes, arms)
    count = len(next(iter(by_arm.values()), []))
    if count == 0:
        return {}
    everyone = [
        i for i in range(count) if all(by_arm[arm][i]["outcome"] == "reached" for arm in arms)
    ]
    summary: dict[str, Any] = {}
    for arm, results in by_arm.items():
        speed = paired_speed(by_arm, arm)
        faults: dict[str, int] = {}
        paths: dict[str, int] = {}
        for r in results:
            for kind, n in r["faults"].items():
                faults[kind] = faults.get(kind, 0) + n
            for kind, n in r["paths"].items():
                paths[kind] = paths.get(kind, 0) + n
        counts = {name: sum(r["outcome"] == name for r in results) for name in OUTCOMES}
        impacts = [r["impact_speed"] for r in results if r["impact_speed"] is not None]
        risk = realised_risk(results)
        entry: dict[str, Any] = {
            "episodes": count,
            **counts,
            "collided_interval": wilson(counts["collided"], count),
            "mean_speed": speed["value"],
            "mean_speed_interval": [speed["low"], speed["high"]],
            "time_to_goal": float(np.mean([results[i]["time"] for i in everyone]))
            if everyone
            else None,
            "time_to_goal_episodes": len(everyone),
            "max_speed": max(r["max_speed"] for r in results),
            "min_clearance": min(r["min_clearance"] for r in results),
            "stops": sum(r["stops"] for r in results),
            "impact_speed": float(np.mean(impacts)) if impacts else None,
            "cycle_ms_p50": float(np.median([r["cycle_ms"][0] for r in results])),
            "cycle_ms_p99": float(np.median([r["cycle_ms"][1] for r in results])),
            "faults": faults,
            "paths": paths,
            "realised_risk": None if risk is None else risk["value"],
            "realised_risk_interval": None if risk is None else [risk["low"], risk["high"]],
        }
        if arm != "known" and "known" in by_arm:
            entry["faster_than_known"] = difference(by_arm, arm, "known")
            entry["collided_p"] = mcnemar(results, by_arm["known"], "collided")
        summary[arm] = entry
    return summary


def gap(episodes: list[Result], arms: tuple[str, ...]) -> dict[str, Any] | None:
    """The share of the gap between `known` and `oracle` that `predicted` closes."""
    by_arm = paired(episodes, arms)
    return share_of_gap(by_arm) if next(iter(by_arm.values()), []) else None


def title(settings: dict[str, Any]) -> str:
    """What was compared, in a line."""
    worlds = settings["world"]
    named = ", ".join(str(world) for world in worlds[:3]) + (" …" if len(worlds) > 3 else "")
    return (
        f"{named}, route {settings['route']}, {settings.get('vehicle', 'dubins')} car; "
        f"window {settings['window']:g} m × "
        f"{settings['expansion']:g}, v_max {settings['v_max']:g} m/s, predictor "
        f"{settings['predictor']}, risk ε = {settings['risk']:g} (0: only what was seen free "
        "counts; 1: all not seen occupied)"
    )


def table(summary: dict[str, Any], share: dict[str, Any] | None) -> str:
    """The summary as a Markdown table and what there is to say beside it."""
    if not summary:
        return "no episode has been finished by all arms yet"
    first = next(iter(summary.values()))
    rows = [[f"{first['episodes']} paired episodes", *(f"`{arm}`" for arm in summary)]]

    def row(title: str, value: Callable[[dict[str, Any]], str]) -> None:
        rows.append([title, *(value(entry) for entry in summary.values())])

    row(
        " / ".join(outcome.replace("_", " ") for outcome in OUTCOMES),
        lambda e: " / ".join(str(e[outcome]) for outcome in OUTCOMES),
    )
    row(
        "collisions, 95 % interval",
        lambda e: "{:.1f}–{:.1f} %".format(*(100 * v for v in e["collided_interval"])),
    )
    row("impact speed [m/s]", lambda e: _number(e["impact_speed"], ".1f"))
    row(
        "speed [m/s] (95 % over worlds)",
        lambda e: "{:.2f} ({:.2f}–{:.2f})".format(e["mean_speed"], *e["mean_speed_interval"]),
    )
    row(
        "faster than `known` [m/s]",
        lambda e: interval(e["faster_than_known"], "+.2f") if "faster_than_known" in e else "",
    )
    row(
        f"time to goal [s], {first['time_to_goal_episodes']} episodes all reached",
        lambda e: _number(e["time_to_goal"], ".1f"),
    )
    row("top speed [m/s]", lambda e: f"{e['max_speed']:.2f}")
    row("least clearance [m]", lambda e: f"{e['min_clearance']:.2f}")
    row("stops", lambda e: str(e["stops"]))
    row("promises broken (95 % over worlds)", broken)
    row(
        "control cycle p50 / p99 [ms]",
        lambda e: f"{e['cycle_ms_p50']:.1f} / {e['cycle_ms_p99']:.1f}",
    )
    row("faults survived", lambda e: str(sum(e["faults"].values())))
    row("paths by OMPL", lambda e: _share(e["paths"]))
    lines = [markdown(rows), ""]
    for name, entry in summary.items():
        if entry["faults"]:
            kinds = ", ".join(f"{kind} {n}" for kind, n in sorted(entry["faults"].items()))
            lines.append(f"Faults survived by `{name}`: {kinds}.")
    if share is not None:
        closed = interval(share, ".0f", 100.0)
        lines.append(f"Prediction closes {closed} % of the gap between `known` and `oracle`.")
    elif {"known", "predicted", "oracle"} <= summary.keys():
        lines.append(
            "Share of the gap: not given, `oracle` is not faster than `known` with certainty."
        )
    return "\n".join(lines).rstrip()


def broken(entry: dict[str, Any]) -> str:
    """The share of promises that an arm broke, and its interval."""
    if entry["realised_risk"] is None:
        return ""
    low, high = entry["realised_risk_interval"]
    return f"{100 * entry['realised_risk']:.2f} % ({100 * low:.1f}–{100 * high:.1f})"


def _number(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)


def _percent(share: float | None, form: str) -> str:
    return "" if share is None else f"{format(100 * share, form)} %"


def _share(paths: dict[str, int]) -> str:
    found = paths.get("ompl", 0) + paths.get("dijkstra", 0)
    return _percent(paths.get("ompl", 0) / found if found else None, ".1f")
