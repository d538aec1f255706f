"""The file report.html: a run as one page that needs no other file and no network."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from html import escape
from pathlib import Path
from string import Template
from typing import Any
from urllib.parse import quote, urlencode

from benchmarks.figures.intervals import forest, speed_and_collisions
from benchmarks.figures.palette import LIMIT_COLOURS
from benchmarks.report.command import command_of
from benchmarks.report.html import inline, table
from benchmarks.report.replay_data import COLOURS, ReplayData
from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.episodes_csv import write_episodes
from benchmarks.runs.saved_run import Run
from benchmarks.runs.settings import up_to_date
from benchmarks.runs.summary import gap, summarise
from benchmarks.runs.summary_text import NO_EPISODE, all_rows, in_words, main_rows, remarks, title
from foresee.infra.atomic_file import write_whole
from foresee.infra.drawing import as_svg, own_style

REPORT = "report.html"
"""Name of the file."""
MOST = 4_500_000
"""Largest size of the replayed drives in a report [bytes]."""
LISTED = 10
"""Largest number of drives in a list."""
TEMPLATE = Path(__file__).with_name("report.html")
AREAS = {
    "observed free": "free",
    "observed occupied": "occupied",
    "not observed": "unknown",
    "predicted free": "likely_free",
    "predicted occupied": "likely_occupied",
    "not observed, used by the plan": "relied",
}
"""Entry of the legend → its colour, a key of `COLOURS`."""
LINES = {
    "plan": ("plan", "line"),
    "last resort": ("last_resort", "line dotted"),
    "window": ("ink", "line dashed"),
}
"""Entry of the legend → its colour, a key of `COLOURS`, and its class in report.css."""
INTERVALS = "Bars are 95 % intervals over buildings; with fewer than 20 buildings there are none."


@dataclass(frozen=True)
class DriveList:
    """A list of drives in a report.

    Attributes:
        title: heading.
        belongs: function from a drive to whether it may be listed.
        rank: function from a drive to its place: the lowest come first.
    """

    title: str
    belongs: Callable[[DriveResult], bool]
    rank: Callable[[DriveResult], float]

    def of(self, drives: Iterable[DriveResult]) -> list[DriveResult]:
        """Return the drives that are listed, at most `LISTED`."""
        return sorted(filter(self.belongs, drives), key=self.rank)[:LISTED]


LISTS = (
    DriveList("Collided", lambda r: r.outcome == "collided", lambda r: -(r.impact_speed or 0.0)),
    DriveList(
        "Stuck or timed out",
        lambda r: r.outcome in ("stuck", "timed_out"),
        lambda r: r.path_length,
    ),
    DriveList(
        "Most promises broken",
        lambda r: r.promises_broken > 0,
        lambda r: -r.promises_broken / r.promises,
    ),
    DriveList(
        "Slowest, of those that reached the goal",
        lambda r: r.outcome == "reached",
        lambda r: r.mean_speed if r.sct is None else r.sct,
    ),
)
"""The lists of a report; `sct` is known but in older results."""


def write_report(run: Run, folder: Path) -> list[Path]:
    """Write report.html and episodes.csv of a run into a folder, and return their paths.

    Raises:
        RunError: if a trace is missing or broken.
    """
    page = report(run)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / REPORT
    # Half a surrogate pair, which the name of a map may hold, is written as \ud800.
    write_whole(path, page.encode(errors="backslashreplace"))
    return [path, write_episodes(run.episodes, folder)]


@own_style()
def report(run: Run) -> str:
    """Return the page of a run.

    Raises:
        RunError: if a trace is missing or broken.
    """
    settings = up_to_date(run.settings)
    lists = {each.title: each.of(run.episodes) for each in LISTS}
    replay = ReplayData(run, _order(run, lists.values()), MOST)
    return Template(TEMPLATE.read_text("utf-8")).substitute(
        _results(run, settings),
        name=escape(run.label),
        title=escape(title(settings)),
        embedded=escape(_embedded(run, replay)),
        legend=_legend(replay),
        lists="".join(_list(name, drives, replay) for name, drives in lists.items()),
        command=escape(command_of(run)),
        settings=table([["setting", "value"], *_named(settings)]),
        made=escape(_made(run)),
        data=replay.json(),
        css=TEMPLATE.with_suffix(".css").read_text("utf-8"),
        js=TEMPLATE.with_name("replay.js").read_text("utf-8"),
    )


def _results(run: Run, settings: dict[str, Any]) -> dict[str, str]:
    """Return the texts, tables and pictures of the page about all drives together."""
    arms = tuple(settings.get("arms", run.arms))
    # Made again, since older files lack some measures.
    summary = summarise(run.episodes, arms)
    if not summary:
        return {"words": NO_EPISODE} | dict.fromkeys(
            ("table", "all_rows", "remarks", "forest", "collisions"), ""
        )
    said = remarks(summary, gap(run.episodes, arms, settings["route"]))
    return {
        "words": inline(in_words(summary, run.episodes)),
        "table": table(_as_html(main_rows(summary))),
        "all_rows": table(_as_html(all_rows(summary))),
        "remarks": "".join(f"<p>{inline(text)}</p>" for text in said),
        "forest": as_svg(forest(summary), f"Time ratio, SCT and speed of each arm. {INTERVALS}"),
        "collisions": as_svg(
            speed_and_collisions(summary), f"Share of collisions over speed. {INTERVALS}"
        ),
    }


def _as_html(rows: list[list[str]]) -> list[list[str]]:
    return [[inline(cell) for cell in row] for row in rows]


def _order(run: Run, lists: Iterable[list[DriveResult]]) -> list[int]:
    """Return the numbers of the episodes in the order in which they are taken into the replay.

    First that of the figures, then the first ones of each list in turn, then all others.
    """
    lists = list(lists)
    listed = [drives[k].index for k in range(LISTED) for drives in lists if k < len(drives)]
    return list(dict.fromkeys([run.showcase, *listed, *run.indices]))


def _embedded(run: Run, replay: ReplayData) -> str:
    """Return which drives can be replayed, in words."""
    if len(replay.episodes) == len(run.indices):
        return f"All {len(replay.drives)} drives."
    numbers = ", ".join(str(index) for index in sorted(replay.indices)) or "none"
    return (
        f"{len(replay.drives)} of {len(run.episodes)} drives, so that this file stays below 5 MB: "
        f"those of the episodes {numbers}."
    )


def _legend(replay: ReplayData) -> str:
    """Return the entries of the replay's legend."""

    def entry(kind: str, style: str, name: str) -> str:
        return f'<li><span class="{kind}" style="{style}"></span>{escape(name)}</li>\n'

    areas = [entry("area", f"background: {COLOURS[of]}", name) for name, of in AREAS.items()]
    lines = [
        entry(kind, f"border-color: {COLOURS[of]}", name) for name, (of, kind) in LINES.items()
    ]
    goal = entry("round", f"background: {COLOURS['goal']}", "goal")
    used = {limit for drive in replay.drives for limit in drive["limit_names"]}
    limits = [
        entry("area", f"background: {colour}", limit)
        for limit, colour in LIMIT_COLOURS.items()
        if limit in used
    ]
    return "".join([*areas, *lines, goal, "<li>speed limited by:</li>", *limits])


def _list(name: str, drives: list[DriveResult], replay: ReplayData) -> str:
    """Return a list of drives with links to their replays; "" without drives."""
    if not drives:
        return ""
    rows = [["episode", "building", "arm", "outcome", "time [s]", "SCT", "promises broken", ""]]
    for r in drives:
        link = urlencode({"drive": r.index, "arm": r.arm}, quote_via=quote)
        there = r.index in replay.indices
        rows.append(
            [
                str(r.index),
                escape(r.world),
                f"<code>{escape(r.arm)}</code>",
                r.outcome.replace("_", " "),
                f"{r.time:.1f}",
                "" if r.sct is None else f"{r.sct:.2f}",
                f"{r.promises_broken} / {r.promises}",
                f'<a href="#{escape(link)}">replay</a>' if there else "",
            ]
        )
    return f"<h3>{name}</h3>\n{table(rows)}\n"


def _named(settings: dict[str, Any]) -> list[list[str]]:
    """Return the name and the value of each setting."""
    return [[f"<code>{escape(k)}</code>", escape(str(v))] for k, v in sorted(settings.items())]


def _made(run: Run) -> str:
    """Return the commits that the drives were made with, in words."""
    commits = sorted({str(episode.commit) for episode in run.episodes})
    return f"Driven with the code of {', '.join(commits)}."
