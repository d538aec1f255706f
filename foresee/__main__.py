"""The command `foresee`, which runs each command by its name, such as `foresee corridor`."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from dataclasses import replace
from textwrap import wrap
from typing import Any

from foresee.infra.streams import lasting_streams

GROUPS = {
    "Drive": {
        "corridor": ("benchmarks.corridor", "drive with and without prediction, and compare"),
        "bench": ("benchmarks.bench", "drive a suite of the race with a predictor or driver"),
        "rank": ("benchmarks.rank", "rank the results of a race"),
        "optimum": ("benchmarks.optimum", "compute time-optimal drives"),
    },
    "Look": {
        "plot": ("benchmarks.plot", "draw the figures of saved runs again"),
        "tables": ("benchmarks.tables", "print the tables of results files"),
        "replay": ("predictor.replay", "predict along a robot's log, and write it for Foxglove"),
    },
    "Predict": {
        "check": ("predictor.check", "check a predictor of your own"),
        "evaluate": ("predictor.evaluate", "score predictors along drives"),
        "calibrate": ("benchmarks.calibrate", "certify a level of the last resort for a risk"),
    },
    "Train": {
        "drives": ("predictor.drives", "make samples to train on"),
        "train": ("predictor.train", "train a network"),
        "train-frontiers": ("predictor.train_frontiers", "train the network of frontiers"),
        "dataset": ("predictor.dataset", "make the frames of the paper's study"),
        "study": ("predictor.study", "train all of the paper's networks"),
    },
    "Set up": {
        "warm-up": ("benchmarks.warm_up", "compile what is compiled at first use, once"),
        "completion": ("foresee.completion", "let a shell complete commands and options"),
    },
}
"""Heading → command → module, and description for the list of commands."""
COMMANDS = {name: command for group in GROUPS.values() for name, command in group.items()}
FIRST = ("corridor", "plot", "check")
"""The commands that a beginner needs."""
INDENTED: dict[str, Any] = {"initial_indent": "  ", "subsequent_indent": "  "}
STUDIES = {
    "prediction": ("katyal2018.__main__", "score predictors on the frames of the paper"),
    "risk": ("risk.__main__", "compare requested with realised risk, and with speed"),
    "worth": ("worth.__main__", "measure what prediction is worth against fair baselines"),
    "stages": ("performance.__main__", "time the stages of the control cycle"),
    "attack": ("robustness.attack", "drive with hostile predictors"),
    "errors": ("robustness.errors", "drive with errors, beyond their bounds, and among people"),
    "interrupt": ("robustness.interrupt", "interrupt long commands, and compare the results"),
    "stuck": ("driver.stuck", "find out why drives got stuck"),
    "weave": ("driver.weave", "measure speed and weaving on straights"),
    "sweeps": ("driver.sweeps", "compare scores that limit the reliance on a prediction"),
    "buildings": ("buildings", "compare generated buildings with maps by numbers"),
    "suites": ("suites", "draw the suites of the race again, and compare them"),
}
"""Command of a study → module in `benchmarks.studies`, and description."""


def commands() -> dict[str, tuple[str, str]]:
    """Return `COMMANDS`; in a checkout also those of the studies, which are not installed."""
    if importlib.util.find_spec("benchmarks.studies") is None:
        return COMMANDS
    studies = {name: (f"benchmarks.studies.{home}", what) for name, (home, what) in STUDIES.items()}
    return COMMANDS | studies


def main(argv: list[str] | None = None) -> int:
    """Run a command by its name, and return its exit status; 2 if there is no such command."""
    with lasting_streams():
        try:
            return _run(sys.argv[1:] if argv is None else argv)
        except OSError:
            # The list cannot be written, as its reader has ended.
            return 1


def _run(words: list[str]) -> int:
    # The working folder comes last in the search path: a plug-in is found there, and a file such
    # as sim.py cannot hide a package of this project.
    sys.path.append("")
    known = commands()
    if words and words[0] in known:
        command = importlib.import_module(known[words[0]][0]).main
        status: int = replace(command, name=f"foresee {words[0]}")(words[1:])
        return status
    if words and words[0] in STUDIES:
        print(f"foresee {words[0]}: a study, which only a checkout of foresee has", file=sys.stderr)
        return 2
    if words == ["--version"]:
        # Imported here, so that the list of commands does not wait for it.
        from foresee.infra.environment import own_version

        print(f"foresee {own_version()}")
        return 0
    print(_overview(known))
    if words in ([], ["-h"], ["--help"]):
        return 0
    print(f"foresee: no command is called {words[0]!r}", file=sys.stderr)
    return 2


def _overview(known: dict[str, tuple[str, str]]) -> str:
    """Return the list of commands: a beginner's first, then the others by their headings."""
    lines = ["usage: foresee COMMAND [options]", "", "Begin with"]
    lines += [_line(name) for name in FIRST]
    for heading, group in GROUPS.items():
        lines += ["", heading, *(_line(name) for name in group if name not in FIRST)]
    studies = [name for name in STUDIES if name in known]
    if studies:
        lines += ["", "Studies of this checkout", *wrap(", ".join(studies), 78, **INDENTED)]
    lines += ["", "foresee COMMAND --help explains each, foresee --version tells the version."]
    return "\n".join(lines)


def _line(name: str) -> str:
    return f"  {name:<16} {COMMANDS[name][1]}"


if __name__ == "__main__":
    sys.exit(main())
