"""The summary of a comparison: the measures of each arm over all paired episodes, and its table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from benchmarks.runs import statistics
from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.settings import up_to_date
from benchmarks.runs.statistics import ResultsByArm
from foresee.infra.markdown import DASH, figure, interval, markdown
from foresee.statistics import MIN_GROUPS
from sim.episode import Outcome

SOURCES = ("route", "hybrid", "ompl", "dijkstra")
"""Sources of the paths that were followed, as in `planner.motion.path.Path.source`."""
OUTCOMES = tuple(map(str, Outcome))


def paired(episodes: list[DriveResult], arms: tuple[str, ...]) -> ResultsByArm:
    """Return the results of each arm on the episodes that all arms have finished, in one order."""
    by_key = {(r.index, r.arm): r for r in episodes}
    indices = sorted({r.index for r in episodes})
    common = [i for i in indices if all((i, arm) in by_key for arm in arms)]
    return {arm: [by_key[i, arm] for i in common] for arm in arms}


def summarise(episodes: list[DriveResult], arms: tuple[str, ...]) -> dict[str, Any]:
    """Return arm → measures over the paired episodes; {} if no episode is finished by all arms."""
    by_arm = paired(episodes, arms)
    if not next(iter(by_arm.values()), []):
        return {}
    return {arm: _measures(by_arm, arm) for arm in arms}


def _measures(by_arm: ResultsByArm, arm: str) -> dict[str, Any]:
    """Compute the measures of an arm over the paired episodes; None for one that is not known."""
    results = by_arm[arm]
    reached = [r for r in results if r.outcome == "reached"]
    together = statistics.reached(by_arm, tuple(by_arm))[arm]
    faults, paths = Counter[str](), Counter[str]()
    for r in results:
        faults.update(r.faults)
        paths.update(r.paths)
    counts = {name: sum(r.outcome == name for r in results) for name in OUTCOMES}
    enough = len({r.world for r in results}) >= MIN_GROUPS
    collided = statistics.wilson(counts["collided"], len(results)) if enough else None
    compared = arm != "known" and "known" in by_arm
    ratio = {"time_ratio": statistics.time_ratio(by_arm, arm, "known")} if compared else {}
    entry: dict[str, Any] = {
        "vehicle": results[0].vehicle,
        **_with_ends("sct", statistics.success(by_arm, arm)),
        "over_optimum": _ratio(reached, "time", "t_opt"),
        "detour": _ratio(reached, "path_length", "shortest_length"),
        "t_bound": _mean(r.t_bound for r in results),
        "t_opt": _mean(r.t_opt for r in results),
        **ratio,
        "episodes": len(results),
        **counts,
        "collided_interval": collided,
        **_with_ends("mean_speed", statistics.mean_speed(by_arm, arm)),
        "time_to_goal": _mean(r.time for r in together),
        "time_to_goal_episodes": len(together),
        "max_speed": max(r.max_speed for r in results),
        "min_clearance": min(r.min_clearance for r in results),
        "stops": sum(r.stops for r in results),
        "impact_speed": _mean(r.impact_speed for r in results),
        "cycle_ms_p50": float(np.median([r.cycle_ms[0] for r in results])),
        "cycle_ms_p99": float(np.median([r.cycle_ms[1] for r in results])),
        "faults": faults,
        "paths": paths,
        **_with_ends("promises_broken", statistics.promises_broken(results)),
    }
    if compared:
        entry["faster_than_known"] = statistics.mean_speed(by_arm, arm, "known")
        entry["collided_p"] = statistics.mcnemar(results, by_arm["known"], "collided")
    return entry


def _with_ends(name: str, estimated: dict[str, Any] | None) -> dict[str, Any]:
    """Return the value and the interval of an estimate, as NAME and NAME_interval."""
    value, low, high = (
        None if estimated is None else estimated[k] for k in ("value", "low", "high")
    )
    return {name: value, f"{name}_interval": None if low is None else [low, high]}


def _ratio(results: list[DriveResult], top: str, bottom: str) -> float | None:
    """Return the sum of one field over the sum of another, for results in which both are known."""
    known = [r for r in results if getattr(r, bottom) is not None]
    sums = [sum(getattr(r, key) for r in known) for key in (top, bottom)]
    return sums[0] / sums[1] if known else None


def _mean(values: Iterable[float | None]) -> float | None:
    """Return the mean of the values that are not None; None if all are."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def gap(episodes: list[DriveResult], arms: tuple[str, ...], route: str) -> dict[str, Any]:
    """Return the share of the gap between `known` and `oracle` that `predicted` closes.

    Returns:
        `sct`: the share in SCT; `time`: the share in time, on a prescribed route only. Each is None
        if `statistics.share_of_gap` gives none.
    """
    by_arm = paired(episodes, arms)
    in_time = statistics.share_of_gap(by_arm, "time") if route == "fixed" else None
    return {"sct": statistics.share_of_gap(by_arm, "sct"), "time": in_time}


def title(settings: dict[str, Any]) -> str:
    """Return the settings of a comparison as one line."""
    settings, worlds = up_to_date(settings), settings["world"]
    places = ", ".join(str(world) for world in worlds[:3]) + (" …" if len(worlds) > 3 else "")
    return (
        f"{places}, route {settings['route']}, {settings['vehicle']} car; "
        f"window {settings['window']:g} m, expansion {settings['expansion']:g}, "
        f"v_max {settings['v_max']:g} m/s, predictor "
        f"{settings['predictor']}, reliance ε = {settings['reliance']:g}, "
        f"risk δ = {settings['risk']:g}, level λ = {settings['level']:g}"
    )


def comparison(results: dict[str, Any]) -> str:
    """Return the title and the table of a comparison's results.json as Markdown."""
    return f"{title(results['settings'])}\n\n{table(results['summary'], results['gap'])}"


def table(summary: dict[str, Any], share: dict[str, Any]) -> str:
    """Return the summary as a Markdown table, with remarks below it.

    Args:
        summary: result of `summarise`.
        share: result of `gap`.
    """
    if not summary:
        return "no episode has been finished by all arms yet"
    first = next(iter(summary.values()))
    rows = [[f"{first['episodes']} paired episodes", *(f"`{arm}`" for arm in summary)]]

    def row(title: str, value: Callable[[dict[str, Any]], str]) -> None:
        rows.append([title, *(value(entry) for entry in summary.values())])

    def plain(title: str, key: str, form: str) -> None:
        row(title, lambda e: "" if e[key] is None else format(e[key], form))

    def estimate(title: str, key: str, form: str) -> None:
        row(title, lambda e: interval(e[key], form) if e.get(key) else "")

    def ended(title: str, key: str, form: str) -> None:
        row(f"{title} (95 % over worlds)", lambda e: figure(e[key], e[f"{key}_interval"], form))

    ended("**SCT**", "sct", ".3f")
    estimate("**time ratio** to `known`, both reached", "time_ratio", ".2f")
    if any(entry["over_optimum"] is not None for entry in summary.values()):
        plain("time over T_opt, where reached", "over_optimum", ".2f")
    together = f"{first['time_to_goal_episodes']} episodes all reached"
    plain(f"time to goal [s], {together}", "time_to_goal", ".1f")
    plain("detour factor, where reached", "detour", ".2f")
    ended("speed [m/s]", "mean_speed", ".2f")
    estimate("faster than `known` [m/s]", "faster_than_known", "+.2f")
    row(
        " / ".join(outcome.replace("_", " ") for outcome in OUTCOMES),
        lambda e: " / ".join(str(e[outcome]) for outcome in OUTCOMES),
    )
    row("collisions, 95 % interval", lambda e: _percent(e["collided_interval"], " %"))
    plain("impact speed [m/s]", "impact_speed", ".1f")
    plain("top speed [m/s]", "max_speed", ".2f")
    plain("least clearance [m]", "min_clearance", ".2f")
    plain("stops", "stops", "d")
    row("promises broken (95 % over worlds)", broken)
    row(
        "control cycle p50 / p99 [ms]",
        lambda e: f"{e['cycle_ms_p50']:.1f} / {e['cycle_ms_p99']:.1f}",
    )
    row("handled faults", lambda e: str(sum(e["faults"].values())))
    row(
        "paths by source",
        lambda e: " / ".join(str(e["paths"].get(source, 0)) for source in SOURCES),
    )
    row("recovery manoeuvres", lambda e: str(e["paths"].get("manoeuvre", 0)))
    lines = [markdown(rows), ""]
    for name, entry in summary.items():
        if entry["faults"]:
            kinds = ", ".join(f"{kind} {n}" for kind, n in sorted(entry["faults"].items()))
            lines.append(f"Handled faults of `{name}`: {kinds}.")
    for key, what in (("sct", "in SCT"), ("time", "in time, where all three reached")):
        if share[key] is not None:
            closed = interval(share[key], ".0f", 100.0)
            lines.append(f"Share of the gap between `known` and `oracle` {what}: {closed} %.")
    # Without an interval there are too few buildings to say anything about the gap.
    if (
        summary.keys() >= set(statistics.GAP)
        and first["sct_interval"] is not None
        and share["sct"] is None
    ):
        lines.append(
            "Share of the gap in SCT: not given, `oracle` is not better than `known` with "
            "certainty."
        )
    return "\n".join(lines).rstrip()


def broken(entry: dict[str, Any]) -> str:
    """Return the share of promises that an arm broke, with its interval, as text."""
    if entry["promises_broken"] is None:
        return ""
    return f"{100 * entry['promises_broken']:.2f} % ({_percent(entry['promises_broken_interval'])})"


def _percent(ends: list[float] | None, unit: str = "") -> str:
    return DASH if ends is None else "–".join(f"{100 * end:.1f}" for end in ends) + unit
