"""Check a predictor: python -m predictor.check my_module:MyPredictor."""

from __future__ import annotations

import sys

from foresee.infra.command_line import OneLineParser, run_command


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 1 if the predictor breaks the contract, 2 if it cannot be loaded."""
    parser = OneLineParser(
        prog="predictor.check",
        description="Check that a predictor keeps to the contract with the planner, and warn of "
        "what would make drives slower or hard to repeat.",
    )
    parser.add_argument(
        "predictor", metavar="P", help="a name, package.module:Class, or a .safetensors file"
    )
    return run_command("predictor.check", lambda: _run(parser.parse_args(argv).predictor))


def _run(name: str) -> int:
    from foresee.checking import check_predictor
    from foresee.prediction import BadPredictionError
    from predictor.registry import load_predictor

    try:
        warnings = check_predictor(load_predictor(name))
    except BadPredictionError as error:
        print(f"{name}: error: {error}")
        return 1
    for warning in warnings:
        print(f"{name}: warning: {warning}")
    print(f"{name}: keeps to the contract, {len(warnings)} warnings")
    return 0


if __name__ == "__main__":
    sys.exit(main())
