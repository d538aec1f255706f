"""Compile all that is compiled when it is first used, so that the first drive need not wait.

    foresee warm-up

The kernels and the derivatives of the MPC are compiled by some short drives. What is compiled is
kept, so this is done once for a machine and a version. The first comparison does it by itself.
"""

from __future__ import annotations

import sys

from foresee.infra.command_line import Command


def _run() -> None:
    # Imported here, so that --help does not wait for slow imports.
    from benchmarks.runs.warm_up import warm_up

    print(warm_up())


main = Command("benchmarks.warm_up", __doc__, _run)

if __name__ == "__main__":
    sys.exit(main())
