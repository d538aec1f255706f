"""Count how much the car weaves: changes of the sign of its curvature on straights.

python -m benchmarks.weave results/corridor --out weave.json
"""

from __future__ import annotations

import sys

from benchmarks.runs.analysis import analyse

DESCRIPTION = """\
Count how often the car changes from one side to the other on straights, in runs of
benchmarks.corridor on a prescribed route. The route is straight where it turns by less than 10°
within 3 m before and behind. Ticks with a curvature below the threshold are ignored.
"""


def main(argv: list[str] | None = None) -> int:
    """Run the command line; return its exit status, 2 for bad input."""
    return analyse("weave", "benchmarks.runs.weaving:counts", DESCRIPTION, argv)


if __name__ == "__main__":
    sys.exit(main())
