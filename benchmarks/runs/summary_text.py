"""The summary of a comparison as text: its title, its table, and what it says in words."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from benchmarks.runs.arms import arm_kind
from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.settings import up_to_date
from foresee.infra.markdown import figure, interval, markdown, span
from foresee.statistics import MIN_GROUPS

SOURCES = ("route", "hybrid", "ompl", "dijkstra")
"""Sources of the paths that were followed, as in `planner.motion.path.Path.source`."""
EARLIER = ", calibrated with an earlier planner"
"""Remark on drives at a risk whose calibration was measured with an earlier revision."""
NOT_CERTIFIED = ", not certified"
"""Remark on drives at a risk for which there is no calibration."""
MAIN_ROWS = (
    *("**time ratio**", "**SCT**", "**BARN score**", r"T\*/time", "speed", "detour"),
    *("reached", "collided", "hard stops", "promises broken", "late "),
)
"""Beginnings of the titles of the rows that are shown first."""
LATE = {"late_ticks": "late controls / ticks", "late_predictions": "late predictions / ticks"}
"""Measure of lateness → title of its row, which is shown where drives could be late."""
ROLES = {"backup": " (no network)", "oracle": " (upper bound)"}
"""Arm → what is said of it in words."""
NO_EPISODE = "no episode has been finished by all arms yet"
"""Text in place of a table."""
ERRORS = {
    "noise": " m",
    "dropout": "",
    **{
        f"{told}{name}": unit
        for told in ("", "told_")
        for name, unit in (
            ("delay", " s"),
            ("jitter", " s"),
            ("lag", " s"),
            ("pose_error", " m"),
            ("yaw_error", " rad"),
        )
    },
    "missed": "",
}
"""Setting of an error of the robot → its unit."""


def title(settings: dict[str, Any]) -> str:
    """Return the settings of a comparison as one line."""
    settings, worlds = up_to_date(settings), settings["world"]
    risk = f", risk {settings['risk']:g}" if settings["risk"] else ""
    level = f", level {settings['level']:g}" if settings["level"] else ""
    places = ", ".join(str(world) for world in worlds[:3]) + (" …" if len(worlds) > 3 else "")
    if settings["tasks"] is not None:
        places += f", tasks {settings['tasks']}"
    if settings["start"] and settings["goal"]:
        start, goal = (", ".join(f"{v:g}" for v in settings[end]) for end in ("start", "goal"))
        places += f", from ({start}) to ({goal})"
    car = "car" if settings["car"] is None else f"car {settings['car']}"
    return (
        f"{places}, route {settings['route']}, {settings['vehicle']} {car}; "
        f"window {settings['window']:g} m, expansion {settings['expansion']:g}, "
        f"v_max {settings['v_max']:g} m/s, predictor "
        f"{settings['predictor']}, reliance {settings['reliance']:g}{risk}{level}"
        f"{_clock(settings)}{_errors(settings)}"
    )


def _clock(settings: dict[str, Any]) -> str:
    """Return whether drives were on the wall clock, and the deadline of predictions, as words."""
    real = ", on the wall clock" if settings["real_time"] else ""
    deadline = settings["deadline"]
    return real + ("" if deadline is None else f", deadline of predictions {deadline:g} s")


def _errors(settings: dict[str, Any]) -> str:
    """Return the errors of the robot, and what the navigator is told of them, as words."""
    words = [
        f"{name.replace('_', ' ')} {settings[name]:g}{unit}"
        for name, unit in ERRORS.items()
        if settings[name] is not None and (settings[name] or name.startswith("told"))
    ]
    return "; errors: " + ", ".join(words) if words else ""


def comparison(results: dict[str, Any]) -> str:
    """Return the title and the table of a comparison's results.json as Markdown."""
    return f"{title(results['settings'])}\n\n{table(results['summary'], results['gap'])}"


def main_table(summary: dict[str, Any]) -> str:
    """Return the main rows of the summary as a Markdown table; `table` has all."""
    return markdown(main_rows(summary)) if summary else NO_EPISODE


def table(summary: dict[str, Any], shares: dict[str, Any]) -> str:
    """Return the summary as a Markdown table, with remarks below it.

    Args:
        summary: result of `summarise`.
        shares: result of `gap`.
    """
    rows = markdown(all_rows(summary)) if summary else NO_EPISODE
    return "\n".join([rows, "", *remarks(summary, shares)]).rstrip()


def main_rows(summary: dict[str, Any]) -> list[list[str]]:
    """Return the head and the main rows of a summary with episodes; cells are Markdown."""
    first, *rows = all_rows(summary)
    return [first, *(row for row in rows if row[0].startswith(MAIN_ROWS))]


def all_rows(summary: dict[str, Any]) -> list[list[str]]:
    """Return the head and all rows of a summary with episodes; cells are Markdown."""
    entries = list(summary.values())
    first = [f"{entries[0]['episodes']} paired episodes", *map(head, summary, entries)]
    return [first, *([title, *map(cell, entries)] for title, cell in _rows(entries).items())]


def in_words(summary: dict[str, Any], drives: Sequence[DriveResult]) -> str:
    """Return the times of a summary and the collisions in words; "" without drives.

    Args:
        summary: result of `summarise`.
        drives: results of all drives. Those of episodes that an arm has not driven are not in the
            summary.
    """
    if not drives:
        return ""
    ratios = {arm: entry.get("time_ratio") for arm, entry in summary.items()}
    compared = {arm: ratio for arm, ratio in ratios.items() if ratio is not None}
    said = []
    if compared:
        times = [
            f"`{arm}`{ROLES.get(arm, '')} {_briefly(ratio)}" for arm, ratio in compared.items()
        ]
        said.append(
            "Times, where that of `known`, which plans within what it observed, is 1: "
            f"{', '.join(times)}."
        )
    # With more buildings, an interval is missing only where all of them agree.
    if any(ratio["groups"] < MIN_GROUPS for ratio in compared.values()):
        said.append("These are too few buildings for intervals.")
    outcomes: dict[str, list[str]] = {}
    for drive in drives:
        outcomes.setdefault(drive.arm, []).append(drive.outcome)
    collided = [
        f"`{arm}` collided in {ended.count('collided')} of {len(ended)} drives."
        for arm, ended in outcomes.items()
        if "collided" in ended
    ]
    return " ".join([*said, *(collided or ["No drive collided."])])


def _briefly(ratio: dict[str, Any]) -> str:
    """Return an estimate with its interval, if it has one."""
    return f"{ratio['value']:.2f}" if ratio["low"] is None else interval(ratio, ".2f")


def head(arm: str, entry: dict[str, Any]) -> str:
    """Return the head of an arm's column."""
    if entry["uncertified"]:
        return f"`{arm}`{NOT_CERTIFIED}"
    return f"`{arm}`" + (EARLIER if entry["earlier_calibration"] else "")


Cell = Callable[[dict[str, Any]], str]
"""Function from the measures of an arm to a cell of the table."""


def _rows(entries: list[dict[str, Any]]) -> dict[str, Cell]:
    """Return the title of each row of the table, and the function of its cells."""
    worlds, together = "(95 % over worlds)", entries[0]["time_to_goal_episodes"]
    rows: dict[str, Cell] = {
        f"**SCT** {worlds}": _ended("sct", ".3f"),
        **_barn_rows(entries, worlds),
        "**time ratio** to `known`, both reached": lambda e: interval(e.get("time_ratio"), ".2f"),
        "time over T_opt, where reached": _plain("over_optimum", ".2f"),
        f"time to goal [s], {together} episodes all reached": _plain("time_to_goal", ".1f"),
        "detour factor, where reached": _plain("detour", ".2f"),
        f"speed [m/s] {worlds}": _ended("mean_speed", ".2f"),
        "faster than `known` [m/s]": lambda e: interval(e.get("faster_than_known"), "+.2f"),
        "reached / timed out / stuck": lambda e: (
            f"{e['reached']} / {e['timed_out']} / {e['stuck']}"
        ),
        f"collided {worlds}": lambda e: (
            f"{e['collided']} ({span(e['collided_interval'], '.1f', 100.0, ' %')})"
        ),
        "impact speed [m/s]": _plain("impact_speed", ".1f"),
        "top speed [m/s]": _plain("max_speed", ".2f"),
        "least clearance [m]": _plain("min_clearance", ".2f"),
        "stops": _plain("stops", "d"),
        "hard stops": _plain("hard_stops", "d"),
        f"promises broken {worlds}": broken,
        "control cycle p50 / p99 [ms]": lambda e: (
            f"{e['cycle_ms_p50']:.1f} / {e['cycle_ms_p99']:.1f}"
        ),
        **{title: _late(key) for key, title in LATE.items()},
        "handled faults": lambda e: str(sum(e["faults"].values())),
        "paths by source": lambda e: " / ".join(str(e["paths"].get(s, 0)) for s in SOURCES),
        "reversals": lambda e: str(e["paths"].get("reversal", 0)),
        "turns on the spot": lambda e: str(e["paths"].get("turn", 0)),
        "recovery manoeuvres": lambda e: str(e["paths"].get("manoeuvre", 0)),
    }
    for key in LATE:
        if all(entry[key] is None for entry in entries):
            del rows[LATE[key]]
    if all(entry["over_optimum"] is None for entry in entries):
        del rows["time over T_opt, where reached"]
    if not any(entry["paths"].get("turn") for entry in entries):
        del rows["turns on the spot"]
    return rows


def _barn_rows(entries: list[dict[str, Any]], worlds: str) -> dict[str, Cell]:
    """Return the rows of the BARN score; none if no task has a T*."""
    if all(entry["barn_score"] is None for entry in entries):
        return {}
    return {
        f"**BARN score**, at most 0.25 {worlds}": _ended("barn_score", ".3f"),
        f"T\\*/time {worlds}": _ended("barn_score_uncut", ".3f"),
    }


def _plain(key: str, form: str) -> Cell:
    """Return a cell of a measure without an interval."""
    return lambda entry: "" if entry[key] is None else format(entry[key], form)


def _late(key: str) -> Cell:
    """Return a cell of a number of ticks that were late."""
    return lambda entry: "" if entry[key] is None else f"{entry[key]} / {entry['ticks']}"


def _ended(key: str, form: str) -> Cell:
    """Return a cell of a measure with its interval."""
    return lambda entry: figure(entry[key], entry[f"{key}_interval"], form)


def broken(entry: dict[str, Any]) -> str:
    """Return the share of promises that an arm broke, with its interval, as text."""
    return figure(entry["promises_broken"], entry["promises_broken_interval"], ".2f", 100.0, " %")


def remarks(summary: dict[str, Any], shares: dict[str, Any]) -> Iterator[str]:
    """Yield the lines below the table: kinds of faults, levels, and shares of the gap."""
    for arm, entry in summary.items():
        if entry["faults"]:
            kinds = ", ".join(f"{kind} {n}" for kind, n in sorted(entry["faults"].items()))
            yield f"Handled faults of `{arm}`: {kinds}."
    for arm, entry in summary.items():
        if arm != arm_kind(arm):
            yield f"`{arm}` drives at level {entry['level']:g}."
    for arm, closed in shares.items():
        for key, what in (("sct", "in SCT"), ("time", "in time, where all reached")):
            if closed[key] is not None:
                share = interval(closed[key], ".0f", 100.0, " %")
                yield (
                    f"`{arm}` closes {share} of the gap {what}, between the best baseline without "
                    f"a network, `{closed[key]['baseline']}`, and the upper bound, `oracle`."
                )
