"""The tables of results files, as Markdown: all that is published comes from here.

python -m benchmarks.tables docs/results/*.json
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from predictor.infra.markdown import DASH, figure, interval, markdown


def tables_of(results: dict[str, Any]) -> str:
    """The tables of one file, of a benchmark or of `predictor.evaluate`.

    Raises:
        KeyError: if it is a file of none.
    """
    if "stages" in results:
        from benchmarks.stages import tables

        return tables(results)
    if results.get("command") == "benchmarks.optimum":
        from benchmarks.runs.optima import table as optima

        return optima(results)
    if results.get("command") == "benchmarks.attack":
        from benchmarks.attack import table as attack

        return attack(results)
    if results.get("command") == "benchmarks.stuck":
        from benchmarks.stuck import table as stuck

        return stuck(results)
    if "simulated" in results:
        from benchmarks.prediction.tables import tables_of as of_prediction

        return of_prediction(results)
    if "groups" in results:
        from benchmarks.recording.evaluation import table as every_score

        return every_score(results)
    from benchmarks.runs.summary import table, title

    return f"{title(results['settings'])}\n\n{table(results['summary'], results['gap'])}"


def summarised(run: dict[str, Any]) -> dict[str, Any]:
    """A comparison with its summary made again of its episodes: old files have fewer figures."""
    from benchmarks.runs.summary import gap, summarise

    episodes, arms = run["episodes"], tuple(run["settings"]["arms"])
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
    """One line for each run of `predicted`: the risk that was asked for, and what became of it.

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
    """One line for each predictor on each group of buildings: how good its probabilities are.

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
    """Run the command line; 2 for bad input."""
    from predictor.infra.command_line import OneLineParser

    parser = OneLineParser(
        prog="benchmarks.tables",
        description="Print the tables of results.json files as Markdown.",
    )
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="results, of "
        "benchmarks.corridor, .optimum, .attack, .stuck, .stages, .prediction, "
        "or predictor.evaluate")  # fmt: skip
    parser.add_argument("--overview", action="store_true", help="print one line a comparison alone")
    args = parser.parse_args(argv)
    from predictor.infra.plain_json import loads

    runs: dict[str, dict[str, Any]] = {}
    relied: dict[str, dict[str, Any]] = {}
    scored: dict[str, dict[str, Any]] = {}
    parts: list[str] = []
    for path in args.files:
        try:
            results = loads(path.read_text())
            if "episodes" in results:
                results = summarised(results)
            parts.append(f"## {path.stem}\n\n{tables_of(results)}\n")
            if {"known", "predicted"} <= results.get("summary", {}).keys():
                runs[path.stem] = results
            if "predicted" in results.get("summary", {}):
                relied[path.stem] = results
            if "groups" in results:
                scored[path.stem] = results
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            print(f"benchmarks.tables: {path} is no results file: {error!r}", file=sys.stderr)
            return 2
    if args.overview:
        print(overview(runs))
        return 0
    if scored:
        parts.insert(0, f"## Scores\n\n{scores(scored)}\n")
    if len(relied) > 1:
        parts.insert(0, f"## Risks\n\n{risks(relied)}\n")
    if len(runs) > 1:
        parts.insert(0, f"## Overview\n\n{overview(runs)}\n")
    print("\n".join(parts), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
