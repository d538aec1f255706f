"""What a run comes to: a summary for machines, and a table for people."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.saved_run import UNNAMED
from benchmarks.runs.statistics import (
    MIN_WORLDS,
    Arms,
    difference,
    mcnemar,
    paired_speed,
    realised_risk,
    share_of_gap,
    share_of_time,
    success,
    time_ratio,
    wilson,
)
from predictor.infra.markdown import DASH, figure, interval, markdown

SOURCES = ("route", "hybrid", "ompl", "dijkstra")
"""Who found the paths that were followed, as `planner.motion.path.Path.source` names them."""
OUTCOMES = ("reached", "collided", "timed_out", "stuck")


def paired(episodes: list[DriveResult], arms: tuple[str, ...]) -> Arms:
    """Return each arm's results on the episodes that all arms have finished, in one order."""
    by_key = {(r.index, r.arm): r for r in episodes}
    indices = sorted({r.index for r in episodes})
    common = [i for i in indices if all((i, arm) in by_key for arm in arms)]
    return {arm: [by_key[i, arm] for i in common] for arm in arms}


def summarise(episodes: list[DriveResult], arms: tuple[str, ...]) -> dict[str, Any]:
    """arm → figures, over the paired episodes; {} while no episode is finished by all arms."""
    by_arm = paired(episodes, arms)
    if not next(iter(by_arm.values()), []):
        return {}
    return {arm: _headline(by_arm, arm) | _details(by_arm, arm) for arm in arms}


def _headline(by_arm: Arms, arm: str) -> dict[str, Any]:
    """Return the figures that lead every table, each None where it is not known."""
    results = by_arm[arm]
    sct = success(by_arm, arm)
    reached = [r for r in results if r.outcome == "reached"]
    entry: dict[str, Any] = {
        "vehicle": results[0].vehicle,
        "sct": None if sct is None else sct["value"],
        "sct_interval": None if sct is None else _ends(sct),
        "over_optimum": _ratio(reached, "time", "t_opt"),
        "detour": _ratio(reached, "path_length", "shortest_length"),
        "t_bound": _mean(results, "t_bound"),
        "t_opt": _mean(results, "t_opt"),
    }
    if arm != "known" and "known" in by_arm:
        entry["time_ratio"] = time_ratio(by_arm, arm, "known")
    return entry


def _details(by_arm: Arms, arm: str) -> dict[str, Any]:
    results = by_arm[arm]
    count = len(results)
    everyone = [
        i for i in range(count) if all(of[i].outcome == "reached" for of in by_arm.values())
    ]
    speed = paired_speed(by_arm, arm)
    faults: dict[str, int] = {}
    paths: dict[str, int] = {}
    for r in results:
        for kind, n in r.faults.items():
            faults[kind] = faults.get(kind, 0) + n
        for kind, n in r.paths.items():
            paths[kind] = paths.get(kind, 0) + n
    counts = {name: sum(r.outcome == name for r in results) for name in OUTCOMES}
    impacts = [r.impact_speed for r in results if r.impact_speed is not None]
    risk = realised_risk(results)
    enough = len({r.world for r in results}) >= MIN_WORLDS
    entry: dict[str, Any] = {
        "episodes": count,
        **counts,
        "collided_interval": wilson(counts["collided"], count) if enough else None,
        "mean_speed": speed["value"],
        "mean_speed_interval": _ends(speed),
        "time_to_goal": float(np.mean([results[i].time for i in everyone])) if everyone else None,
        "time_to_goal_episodes": len(everyone),
        "max_speed": max(r.max_speed for r in results),
        "min_clearance": min(r.min_clearance for r in results),
        "stops": sum(r.stops for r in results),
        "impact_speed": float(np.mean(impacts)) if impacts else None,
        "cycle_ms_p50": float(np.median([r.cycle_ms[0] for r in results])),
        "cycle_ms_p99": float(np.median([r.cycle_ms[1] for r in results])),
        "faults": faults,
        "paths": paths,
        "realised_risk": None if risk is None else risk["value"],
        "realised_risk_interval": None if risk is None else _ends(risk),
    }
    if arm != "known" and "known" in by_arm:
        entry["faster_than_known"] = difference(by_arm, arm, "known")
        entry["collided_p"] = mcnemar(results, by_arm["known"], "collided")
    return entry


def _ends(estimated: dict[str, Any]) -> list[float] | None:
    """Return the interval of an estimate; None if there is none."""
    return None if estimated["low"] is None else [estimated["low"], estimated["high"]]


def _ratio(results: list[DriveResult], top: str, bottom: str) -> float | None:
    """Return the sum of one figure over that of another, where both are known."""
    known = [
        (getattr(r, top), getattr(r, bottom)) for r in results if getattr(r, bottom) is not None
    ]
    return sum(a for a, _ in known) / sum(b for _, b in known) if known else None


def _mean(results: list[DriveResult], key: str) -> float | None:
    known = [getattr(r, key) for r in results if getattr(r, key) is not None]
    return float(np.mean(known)) if known else None


def gap(episodes: list[DriveResult], arms: tuple[str, ...], route: str) -> dict[str, Any]:
    """Return the share of the gap between `known` and `oracle` that `predicted` closes.

    Returns:
        `sct`: the share in SCT; `time`: in time, on a prescribed route alone. Each None where it
        cannot be given.
    """
    by_arm = paired(episodes, arms)
    in_time = share_of_time(by_arm) if route == "fixed" else None
    return {"sct": share_of_gap(by_arm), "time": in_time}


def title(settings: dict[str, Any]) -> str:
    """Return in a line what was compared."""
    worlds = settings["world"]
    named = ", ".join(str(world) for world in worlds[:3]) + (" …" if len(worlds) > 3 else "")
    return (
        f"{named}, route {settings['route']}, {(UNNAMED | settings)['vehicle']} car; "
        f"window {settings['window']:g} m × "
        f"{settings['expansion']:g}, v_max {settings['v_max']:g} m/s, predictor "
        f"{settings['predictor']}, risk ε = {settings['risk']:g} (0: only what was seen free "
        "counts; 1: all not seen occupied)"
    )


def comparison(results: dict[str, Any]) -> str:
    """Return the title and the table of a comparison's results.json as Markdown."""
    return f"{title(results['settings'])}\n\n{table(results['summary'], results['gap'])}"


def table(summary: dict[str, Any], share: dict[str, Any]) -> str:
    """Return the summary as a Markdown table, and remarks below it.

    Args:
        summary: of `summarise`.
        share: of `gap`.
    """
    if not summary:
        return "no episode has been finished by all arms yet"
    first = next(iter(summary.values()))
    rows = [[f"{first['episodes']} paired episodes", *(f"`{arm}`" for arm in summary)]]

    def row(title: str, value: Callable[[dict[str, Any]], str]) -> None:
        rows.append([title, *(value(entry) for entry in summary.values())])

    row("**SCT** (95 % over worlds)", lambda e: figure(e["sct"], e["sct_interval"], ".3f"))
    row("**time ratio** to `known`, both reached", lambda e: _estimate(e, "time_ratio", ".2f"))
    if any(entry["over_optimum"] is not None for entry in summary.values()):
        row("time over T_opt, where reached", lambda e: _number(e["over_optimum"], ".2f"))
    row(
        f"time to goal [s], {first['time_to_goal_episodes']} episodes all reached",
        lambda e: _number(e["time_to_goal"], ".1f"),
    )
    row("detour factor, where reached", lambda e: _number(e["detour"], ".2f"))
    row(
        "speed [m/s] (95 % over worlds)",
        lambda e: figure(e["mean_speed"], e["mean_speed_interval"], ".2f"),
    )
    row("faster than `known` [m/s]", lambda e: _estimate(e, "faster_than_known", "+.2f"))
    row(
        " / ".join(outcome.replace("_", " ") for outcome in OUTCOMES),
        lambda e: " / ".join(str(e[outcome]) for outcome in OUTCOMES),
    )
    row(
        "collisions, 95 % interval",
        lambda e: (
            DASH
            if e["collided_interval"] is None
            else "{:.1f}–{:.1f} %".format(*(100 * v for v in e["collided_interval"]))
        ),
    )
    row("impact speed [m/s]", lambda e: _number(e["impact_speed"], ".1f"))
    row("top speed [m/s]", lambda e: f"{e['max_speed']:.2f}")
    row("least clearance [m]", lambda e: f"{e['min_clearance']:.2f}")
    row("stops", lambda e: str(e["stops"]))
    row("promises broken (95 % over worlds)", broken)
    row(
        "control cycle p50 / p99 [ms]",
        lambda e: f"{e['cycle_ms_p50']:.1f} / {e['cycle_ms_p99']:.1f}",
    )
    row("faults survived", lambda e: str(sum(e["faults"].values())))
    row(
        "paths: route / arcs / OMPL / undrivable",
        lambda e: " / ".join(str(e["paths"].get(source, 0)) for source in SOURCES),
    )
    row("ways out of rest", lambda e: str(e["paths"].get("manoeuvre", 0)))
    lines = [markdown(rows), ""]
    for name, entry in summary.items():
        if entry["faults"]:
            kinds = ", ".join(f"{kind} {n}" for kind, n in sorted(entry["faults"].items()))
            lines.append(f"Faults survived by `{name}`: {kinds}.")
    for key, what in (("sct", "in SCT"), ("time", "in time, where all three reached")):
        if share[key] is not None:
            closed = interval(share[key], ".0f", 100.0)
            lines.append(f"Share of the gap between `known` and `oracle` {what}: {closed} %.")
    # Without an interval there is too little to speak of a gap at all.
    known = {"known", "predicted", "oracle"} <= summary.keys() and first["sct_interval"] is not None
    if known and share["sct"] is None:
        lines.append(
            "Share of the gap in SCT: not given, `oracle` is not better than `known` with "
            "certainty."
        )
    return "\n".join(lines).rstrip()


def broken(entry: dict[str, Any]) -> str:
    """Return the share of promises that an arm broke, and its interval."""
    if entry["realised_risk"] is None:
        return ""
    ends = entry["realised_risk_interval"]
    told = DASH if ends is None else f"{100 * ends[0]:.1f}–{100 * ends[1]:.1f}"
    return f"{100 * entry['realised_risk']:.2f} % ({told})"


def _estimate(entry: dict[str, Any], key: str, form: str) -> str:
    value = entry.get(key)
    return "" if value is None else interval(value, form)


def _number(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)
