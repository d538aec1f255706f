"""What a run comes to: a summary for machines, and a table for people."""

from __future__ import annotations

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
            "realised_risk": realised_risk(results),
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


def table(summary: dict[str, Any], share: dict[str, Any] | None) -> str:
    """The summary as lines of text."""
    if not summary:
        return "no episode has been finished by all arms yet"
    rows: list[tuple[str, list[str]]] = [("arm", list(summary))]

    def row(title: str, value: Any) -> None:
        rows.append((title, [value(entry) for entry in summary.values()]))

    row("episodes", lambda e: str(e["episodes"]))
    for outcome in OUTCOMES:
        row(outcome.replace("_", " "), lambda e, o=outcome: str(e[o]))
    row("collisions, 95 %", lambda e: "{:.1%}–{:.1%}".format(*e["collided_interval"]))
    row("impact speed [m/s]", lambda e: _number(e["impact_speed"], ".2f"))
    row("speed [m/s]", lambda e: f"{e['mean_speed']:.2f}")
    row("  95 %", lambda e: "{:.2f}–{:.2f}".format(*e["mean_speed_interval"]))
    row("faster than known", lambda e: _signed(e.get("faster_than_known")))
    row("time to goal [s]", lambda e: _number(e["time_to_goal"], ".1f"))
    row("peak speed [m/s]", lambda e: f"{e['max_speed']:.2f}")
    row("min. clearance [m]", lambda e: f"{e['min_clearance']:.2f}")
    row("stops", lambda e: str(e["stops"]))
    row("promises broken", lambda e: _number(e["realised_risk"], ".2%"))
    row("cycle p50 [ms]", lambda e: f"{e['cycle_ms_p50']:.1f}")
    row("cycle p99 [ms]", lambda e: f"{e['cycle_ms_p99']:.1f}")
    row("faults survived", lambda e: str(sum(e["faults"].values())))
    row("paths by OMPL", lambda e: _share(e["paths"]))
    first = max(len(title) for title, _ in rows)
    widths = [max(len(cells[i]) for _, cells in rows) for i in range(len(summary))]
    lines = [
        f"{title:<{first}}  " + "  ".join(f"{c:>{w}}" for c, w in zip(cells, widths, strict=True))
        for title, cells in rows
    ]
    lines.insert(1, "-" * max(len(line) for line in lines))
    reached = next(iter(summary.values()))["time_to_goal_episodes"]
    lines.append(f"time to goal: mean of the {reached} episodes that all arms reached")
    for name, entry in summary.items():
        if entry["faults"]:
            kinds = ", ".join(f"{kind} {n}" for kind, n in sorted(entry["faults"].items()))
            lines.append(f"faults survived by {name}: {kinds}")
    if share is not None:
        lines.append(
            f"share of the gap between known and oracle that prediction closes: "
            f"{share['value']:.0%} (95 %: {share['low']:.0%} to {share['high']:.0%})"
        )
    elif {"known", "predicted", "oracle"} <= summary.keys():
        lines.append("share of the gap: not given, oracle is not faster than known with certainty")
    return "\n".join(lines)


def _number(value: float | None, form: str) -> str:
    return "–" if value is None else format(value, form)


def _signed(value: dict[str, float] | None) -> str:
    if value is None:
        return "–"
    return f"{value['value']:+.2f} ({value['low']:+.2f}…{value['high']:+.2f})"


def _share(paths: dict[str, int]) -> str:
    found = paths.get("ompl", 0) + paths.get("dijkstra", 0)
    return f"{paths.get('ompl', 0) / found:.1%}" if found else "–"
