"""Options are fields of settings classes: types, limits, defaults, sections and error lines."""

from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import Annotated

import pytest

from foresee.infra.command_line import Command, Section, UsageError
from foresee.infra.options import Options, argument, given, option

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Route(Options):
    stops: tuple[str, ...] = argument("places to visit", "STOP")
    speed: float = option(MISSING, "speed [m/s]", "V", low=0.5, high=10)
    rests: int | None = option(None, "number of rests", "N", low=0)
    log: Path | None = option(None, "file of the log", "FILE")
    pauses: tuple[float, ...] = option((1.0, 2.5), "durations of pauses [s]", "S", low=0)
    gear: str = option("low", "gear of the car", choices=("low", "high"))
    fast_start: bool = option(False, "start at full speed")
    inner: int = 7


def parsed(*words):
    """The settings of a command line."""
    runs = []

    def run(route: Route) -> None:
        runs.append(route)

    assert Command("drive", None, run)(list(words)) == 0
    return runs[0]


def test_words_become_values_of_the_types_of_the_fields():
    words = "a b --speed 3 --rests 2 --log x/y --pauses 4 5 --gear high --fast-start"
    route = parsed(*words.split())
    assert route == Route(("a", "b"), 3.0, 2, Path("x/y"), (4.0, 5.0), "high", True)
    assert isinstance(route.speed, float)


def test_without_words_the_defaults_hold_and_are_known():
    route = parsed("a", "--speed", "3")
    assert route == Route(("a",), 3.0)
    assert route.changed() == ["stops", "--speed"]
    assert given(rests=route.rests, speed=route.speed) == {"speed": 3.0}


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("a", "the following arguments are required: --speed"),
        ("--speed 3", "the following arguments are required: STOP"),
        ("a --speed 11", "--speed is 11.0, it must lie between 0.5 and 10"),
        ("a --speed nan", "--speed is nan, it must lie between 0.5 and 10"),
        ("a --speed 3 --rests -1", "--rests is -1, it must be at least 0"),
        ("a --speed 3 --rests 1.5", "argument --rests: invalid int value: '1.5'"),
        ("a --speed 3 --pauses 1 -2", "--pauses is -2.0, it must be at least 0"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_line(words, line, capsys):
    def run(route: Route) -> None:
        raise AssertionError

    assert Command("drive", None, run)(words.split()) == 2
    assert capsys.readouterr().err == f"drive: {line}\n"


def test_limits_and_choices_hold_for_settings_made_in_python():
    with pytest.raises(UsageError, match="--speed is 0"):
        Route(("a",), 0.0)
    with pytest.raises(UsageError, match="--gear is third, it must be of low, high"):
        Route(("a",), 1.0, gear="third")


def test_the_help_has_sections_defaults_and_the_lines_of_examples(capsys):
    def run(route: Annotated[Route, Section("the journey", ("stops", "pauses"))]) -> None:
        raise AssertionError

    with pytest.raises(SystemExit):
        Command("drive", "Drive.\n\n    drive a   to a\n    drive b   to b\n", run)(["--help"])
    text = capsys.readouterr().out
    assert "    drive a   to a\n    drive b   to b\n" in text
    assert "the journey:\n" in text
    assert "(default: 1.0 2.5)" in text
    assert "--speed" not in text


def test_the_help_begins_with_what_must_be_given_and_the_general_options(capsys):
    below = {"the stay": ("rests", "pauses")}

    def run(route: Annotated[Route, Section(below=below)]) -> None:
        raise AssertionError

    with pytest.raises(SystemExit):
        Command("drive", None, run)(["--help"])
    general, stay = capsys.readouterr().out.split("the stay:\n")
    assert general.startswith("usage: drive [options] --speed V STOP [STOP ...]\n")
    assert "--gear" in general
    assert "--rests" not in general
    assert [line.split()[0] for line in stay.splitlines() if "--" in line] == [
        "--rests",
        "--pauses",
    ]


def test_there_is_no_other_kind_of_option():
    packages = ("foresee", "planner", "predictor", "sim", "benchmarks")
    sources = [path for package in packages for path in (ROOT / package).rglob("*.py")]
    parsers = {path.name for path in sources if "import argparse" in path.read_text()}
    assert parsers == {"command_line.py", "completion.py", "options.py"}
