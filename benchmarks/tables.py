"""The tables of results files, as Markdown: all that is published comes from here.

python -m benchmarks.tables docs/results/*.json
"""

from __future__ import annotations

import sys
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

from predictor.infra.command_line import OneLineParser, UsageError, run_command
from predictor.infra.errors import one_line
from predictor.infra.markdown import DASH, figure, interval, markdown
from predictor.infra.results_file import COMMANDS, read_results

if TYPE_CHECKING:
    import argparse


TABLES = {
    "comparison": "benchmarks.runs.summary:comparison",
    "optimum": "benchmarks.runs.optima:table",
    "attack": "benchmarks.robustness.hostile_drives:table",
    "interrupt": "benchmarks.robustness.interruptions:table",
    "stuck": "benchmarks.stuck:table",
    "weave": "benchmarks.weave:table",
    "stages": "benchmarks.timing.tables:tables",
    "prediction": "benchmarks.prediction.tables:tables_of",
    "evaluation": "benchmarks.recording.evaluation:table",
}
"""The function that turns each kind of results into Markdown; imported when it is needed."""


def tables_of(results: dict[str, Any]) -> str:
    """Return the tables of one file, of a benchmark or of `predictor.evaluate`."""
    return str(resolve_name(TABLES[results["kind"]])(results))


def summarised(run: dict[str, Any]) -> dict[str, Any]:
    """Summarise a comparison's episodes again: old files have fewer figures."""
    from benchmarks.runs.drive_result import DriveResult
    from benchmarks.runs.summary import gap, summarise

    episodes, arms = [*map(DriveResult.from_json, run["episodes"])], tuple(run["settings"]["arms"])
    route = run["settings"]["route"]
    return run | {"summary": summarise(episodes, arms), "gap": gap(episodes, arms, route)}


def overview(runs: dict[str, dict[str, Any]]) -> str:
    """Return a table of one line for each comparison: what prediction brought, and its price.

    A dash stands for an arm that did not drive, and for a figure that older results lack.

    Args:
        runs: name → contents of a results.json of `benchmarks.corridor`.
    """
    arms = ("known", "predicted", "oracle", "full")
    rows = [[" / ".join(f"`{arm}`" for arm in arms), "car", "episodes", "SCT",
             "time ratio `predicted` to `known`", "gap closed in SCT", "gap closed in time",
             "detour", "speed [m/s]", "reached", "stuck", "collided"]]  # fmt: skip
    for name, run in runs.items():
        summary = run["summary"]

        def each(key: str, form: str, of: dict[str, Any] = summary) -> str:
            values = [of[arm][key] if arm in of else None for arm in arms]
            return " / ".join(DASH if value is None else format(value, form) for value in values)

        known, ratio, shares = summary["known"], summary["predicted"]["time_ratio"], run["gap"]
        closed = ["" if shares[key] is None else interval(shares[key], ".0f", 100.0) + " %"
                  for key in ("sct", "time")]  # fmt: skip
        if "oracle" in summary and shares["sct"] is None and known["sct_interval"] is not None:
            closed[0] = "no gap"
        rows.append([
            name,
            known["vehicle"],
            str(known["episodes"]),
            each("sct", ".3f"),
            "" if ratio is None else interval(ratio, ".2f"),
            *closed,
            each("detour", ".2f"),
            each("mean_speed", ".2f"),
            *(each(key, "d") for key in ("reached", "stuck", "collided")),
        ])  # fmt: skip
    return markdown(rows)


def risks(runs: dict[str, dict[str, Any]]) -> str:
    """Return a line for each run of `predicted`: the risk asked for and the realised one.

    Args:
        runs: name → contents of a results.json of `benchmarks.corridor`, `summarised`.
    """
    from benchmarks.runs.summary import broken

    rows = [["run", "predictor", "expansion", "ε", "promises broken (95 % over worlds)", "episodes",
             "reached", "collided", "SCT", "speed [m/s]"]]  # fmt: skip
    for name, run in runs.items():
        settings, entry = run["settings"], run["summary"]["predicted"]
        rows.append([
            name,
            f"`{Path(settings['predictor']).stem}`",
            f"{settings['expansion']:g}",
            f"{settings['risk']:g}",
            broken(entry),
            *(str(entry[key]) for key in ("episodes", "reached", "collided")),
            figure(entry["sct"], entry["sct_interval"], ".3f"),
            figure(entry["mean_speed"], entry["mean_speed_interval"], ".2f"),
        ])  # fmt: skip
    return markdown(rows)


def scores(runs: dict[str, dict[str, Any]]) -> str:
    """Return a line for each predictor on each group of buildings: its scores.

    Args:
        runs: name → contents of a results.json of `predictor.evaluate`.
    """
    columns = ("iou_free", "iou_occupied", "auc_free", "brier_free", "nll", "ece_free", "ssim")
    rows = [["buildings", "predictor", *(name.replace("_", " ") for name in columns)]]
    for run in runs.values():
        for group, entry in run["groups"].items():
            for name, row in entry["predictors"].items():
                if "(" not in name:
                    found = [row.get(column) for column in columns]
                    cells = ["" if value is None else f"{value:.3f}" for value in found]
                    rows.append([group, f"`{name}`", *cells])
    return markdown(rows)


def main(argv: list[str] | None = None) -> int:
    """Run the command line; return its exit status, 2 for bad input."""
    parser = OneLineParser(
        prog="benchmarks.tables",
        description="Print the tables of results.json files as Markdown.",
    )
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="results of "
        f"{', '.join(COMMANDS.values())}")  # fmt: skip
    parser.add_argument("--overview", action="store_true",
                        help="print one table alone, with a line for each comparison")  # fmt: skip
    return run_command("benchmarks.tables", lambda: _run(parser.parse_args(argv)))


def _run(args: argparse.Namespace) -> None:
    files = [(path.stem, _read(path)) for path in args.files]
    relied = {name: of for name, of in files if "predicted" in of.get("summary", {})}
    runs = {name: of for name, of in relied.items() if "known" in of["summary"]}
    scored = {name: of for name, of in files if of["kind"] == "evaluation"}
    if args.overview:
        print(overview(runs))
        return
    parts = [f"## {name}\n\n{of['tables']}\n" for name, of in files]
    if scored:
        parts.insert(0, f"## Scores\n\n{scores(scored)}\n")
    if len(relied) > 1:
        parts.insert(0, f"## Risks\n\n{risks(relied)}\n")
    if len(runs) > 1:
        parts.insert(0, f"## Overview\n\n{overview(runs)}\n")
    print("\n".join(parts), end="")


def _read(path: Path) -> dict[str, Any]:
    """Read a file of results, and add its `tables`."""
    results = read_results(path)
    try:
        if results["kind"] == "comparison":
            results = summarised(results)
        return results | {"tables": tables_of(results)}
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise UsageError(f"{path} is no results file: {one_line(error)}") from None


if __name__ == "__main__":
    sys.exit(main())
