"""Find out why drives got stuck: when the goal could last be reached, on the true map.

python -m benchmarks.stuck results/real --out stuck.json
"""

from __future__ import annotations

import sys

from benchmarks.runs.analysis import analyse

DESCRIPTION = """\
Find out why drives of the dubins car got stuck. For each stuck drive of a run of
benchmarks.corridor, a search over the true map tries to reach the goal from where the car stands,
then from ever earlier states of the drive. The search is that of sim.task, not the planner's; it
keeps about 0.1 m from walls.
"""


def main(argv: list[str] | None = None) -> int:
    """Run the command line; return its exit status, 2 for bad input."""
    return analyse("stuck", "benchmarks.runs.stuck_drives:causes", DESCRIPTION, argv)


if __name__ == "__main__":
    sys.exit(main())
