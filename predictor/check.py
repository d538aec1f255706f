"""Check that a predictor keeps to the contract with the planner.

    foresee check my_module:MyPredictor

It also warns of what would make drives slower or hard to repeat. Exit status: 1 if the predictor
breaks the contract, 2 if it cannot be loaded.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

from foresee.infra.command_line import Command
from foresee.infra.options import Options, argument


@dataclass(frozen=True)
class CheckSettings(Options):
    """What is checked."""

    predictor: str = argument("a name, package.module:Class, or a .safetensors file", "P")


def _run(settings: CheckSettings) -> int:
    # Imported here, so that --help does not wait for slow imports.
    from foresee.checking import check_predictor
    from foresee.prediction import BadPredictionError
    from predictor.registry import load_predictor

    name = settings.predictor
    try:
        warnings = check_predictor(load_predictor(name))
    except BadPredictionError as error:
        print(f"{name}: error: {error}")
        return 1
    for warning in warnings:
        print(f"{name}: warning: {warning}")
    print(f"{name}: keeps to the contract, {len(warnings)} warnings")
    return 0


main = Command("predictor.check", __doc__, _run)

if __name__ == "__main__":
    sys.exit(main())
