"""Check that a predictor keeps to the contract with the planner, and that it is fit for use.

    foresee check my_module:MyPredictor

First it is asked about several maps, and its answers are checked. Then it drives for a few seconds
in each of eight buildings, on which no network is trained. That shows whether its probabilities are
right, how many of its promises are broken, and how long it takes. Exit status: 1 if it breaks the
contract or more than a quarter of its promises, 2 if it cannot be loaded.
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
    from foresee.infra.progress import progress
    from foresee.prediction import BadPredictionError
    from predictor.evaluation import trial
    from predictor.registry import load_predictor

    name = settings.predictor
    predictor = load_predictor(name)
    try:
        warnings = list(check_predictor(predictor))
        with progress(total=trial.BUILDINGS, unit="drive", leave=False) as bar:
            measured = trial.tried(predictor, bar.update)
    except BadPredictionError as error:
        print(f"{name}: error: {error}")
        return 1
    warnings += measured.warnings()
    errors = measured.errors()
    print(measured.table(name), end="\n\n")
    for line in errors:
        print(f"{name}: error: {line}")
    for line in warnings:
        print(f"{name}: warning: {line}")
    fit = "is not fit to drive with" if errors else "is fit to drive with"
    print(f"{name}: keeps to the contract and {fit}, {len(warnings)} warnings")
    return 1 if errors else 0


main = Command("predictor.check", __doc__, _run, resumes=False)

if __name__ == "__main__":
    sys.exit(main())
