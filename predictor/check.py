"""Check a predictor: python -m predictor.check my_module:MyPredictor."""

from __future__ import annotations

import sys

from predictor.checking import check_predictor
from predictor.prediction import BadPredictionError
from predictor.registry import PredictorError, load_predictor


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 1 if the predictor breaks the contract, 2 if it cannot be loaded."""
    # Here, as in the other commands: the parser belongs to the benchmarks.
    from predictor.infra.command_line import OneLineParser

    parser = OneLineParser(
        prog="predictor.check",
        description="Check that a predictor keeps to the contract with the planner, and name what "
        "would make drives slower or hard to repeat.",
    )
    parser.add_argument("predictor", metavar="P",
                        help="a name, package.module:Class, or a .safetensors file")  # fmt: skip
    args = parser.parse_args(argv)
    try:
        warnings = check_predictor(load_predictor(args.predictor))
    except PredictorError as error:
        print(f"predictor.check: {error}", file=sys.stderr)
        return 2
    except BadPredictionError as error:
        print(f"{args.predictor}: error: {error}")
        return 1
    for warning in warnings:
        print(f"{args.predictor}: warning: {warning}")
    print(f"{args.predictor}: keeps to the contract, {len(warnings)} warnings")
    return 0


if __name__ == "__main__":
    sys.exit(main())
