"""The tables of results files, as Markdown: all that is published comes from here.

python -m benchmarks.tables docs/results/*.json
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any


def markdown(rows: list[list[str]]) -> str:
    """A table whose first row is its head, padded so that it reads well as plain text too."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = [
        "| " + " | ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) + " |"
        for row in rows
    ]
    return "\n".join([lines[0], "|" + "|".join("-" * (w + 2) for w in widths) + "|", *lines[1:]])


def tables_of(results: dict[str, Any]) -> str:
    """The tables of one file, of `benchmarks.corridor` or of `predictor.evaluate`.

    Raises:
        KeyError: if it is a file of neither.
    """
    if "groups" in results:
        from predictor.evaluate import table as scores

        return scores(results)
    from benchmarks.summary import table, title

    return f"{title(results['settings'])}\n\n{table(results['summary'], results['gap'])}"


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 2 for bad input."""
    from benchmarks.settings import OneLineParser

    parser = OneLineParser(
        prog="benchmarks.tables",
        description="Print the tables of results.json files as Markdown.",
    )
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="results.json, of "
        "benchmarks.corridor or of predictor.evaluate")  # fmt: skip
    for path in parser.parse_args(argv).files:
        try:
            text = tables_of(json.loads(path.read_text()))
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            print(f"benchmarks.tables: {path} is no results file: {error!r}", file=sys.stderr)
            return 2
        print(f"## {path.stem}\n\n{text}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
