"""Rank the results of a race: print the table and the duels, and write the page.

foresee rank docs/results/race/corridor-v1/*.json --out ranking.md
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from foresee.infra.command_line import Command
from foresee.infra.options import Options, argument, option


@dataclass(frozen=True)
class RankSettings(Options):
    """What is ranked."""

    files: tuple[Path, ...] = argument("results of benchmarks.bench, of the same suite", "FILE")
    out: Path | None = option(None, "file of the page, in Markdown (default: none)", "FILE.md")


def _run(settings: RankSettings) -> None:
    # Imported here, so that --help does not wait for slow imports.
    from benchmarks.race.ranking import ranking_page, read_entrants
    from foresee.infra.atomic_file import write_whole

    page = ranking_page(read_entrants(settings.files))
    print(page, end="")
    if settings.out is not None:
        settings.out.parent.mkdir(parents=True, exist_ok=True)
        write_whole(settings.out, page.encode())


main = Command("benchmarks.rank", __doc__, _run, resumes=False)

if __name__ == "__main__":
    sys.exit(main())
