"""Settings classes whose fields are command-line options with default, limits and help."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import Field, dataclass, field, fields
from typing import Any, Self

from foresee.infra.command_line import UsageError


def option(
    default: Any,
    help: str,
    metavar: str | None = None,
    *,
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] | None = None,
    parse: Callable[[str], Any] | None = None,
) -> Any:
    """Declare a field of a subclass of `Options` that is a command-line option.

    Args:
        default: default value; a bool makes a flag, a tuple an option of one or more words.
        help: description of the setting, for --help and for readers of the code.
        metavar: placeholder of the value in the help.
        low: smallest number allowed.
        high: largest number allowed.
        choices: words allowed.
        parse: function from a word to the value; by default the type of `default`.
    """
    told = {"help": help, "metavar": metavar, "choices": choices, "parse": parse}
    return field(default=default, metadata=told | {"low": low, "high": high})


@dataclass(frozen=True)
class Options:
    """Base class of settings that are read from a command line.

    Fields that are declared with `option` are options of the command; others are not.

    Raises:
        UsageError: if a number lies outside of its limits, or a word is not among the choices.
    """

    def __post_init__(self) -> None:
        for one in fields(self):
            low, high = one.metadata.get("low"), one.metadata.get("high")
            value, choices = getattr(self, one.name), one.metadata.get("choices")
            several = value if isinstance(value, tuple) else (value,)
            for number in several if low is not None else ():
                if not low <= number <= high:
                    raise UsageError(
                        f"{_flag(one)} is {number}, it must lie between {low} and {high}"
                    )
            if choices and not set(several) <= set(choices):
                raise UsageError(f"{_flag(one)} is {value}, it must be of {', '.join(choices)}")

    @classmethod
    def add_to(cls, parser: argparse._ActionsContainer, *names: str) -> None:
        """Add the options to a parser or to an argument group.

        Args:
            parser: parser or group to which the options are added.
            names: names of the fields to add; all if none is given.
        """
        for one in fields(cls):
            if "help" in one.metadata and (not names or one.name in names):
                _add(parser, one)

    @classmethod
    def of(cls, args: argparse.Namespace, *names: str) -> Self:
        """Make the settings from the parsed arguments of a command line.

        Args:
            args: parsed arguments.
            names: names of the fields to take from them; all if none is given.
        """
        wanted = [f.name for f in fields(cls) if not names or f.name in names]
        given = {name: getattr(args, name) for name in wanted if hasattr(args, name)}
        return cls(**{k: tuple(v) if isinstance(v, list) else v for k, v in given.items()})


def _add(parser: argparse._ActionsContainer, one: Field[Any]) -> None:
    told, default = one.metadata, one.default
    if isinstance(default, bool):
        parser.add_argument(_flag(one), action="store_true", help=told["help"])
        return
    many = isinstance(default, tuple) and told["parse"] is None
    words, kind = default, type(default)
    if isinstance(default, tuple):
        words = (" " if many else ",").join(map(str, default))
        kind = type(default[0]) if default else str
    parser.add_argument(
        _flag(one),
        default=default,
        type=told["parse"] or kind,
        nargs="+" if many else None,
        metavar=told["metavar"],
        choices=told["choices"],
        help=told["help"] if default in (None, ()) else f"{told['help']} (default: {words})",
    )


def _flag(one: Field[Any]) -> str:
    return "--" + one.name.replace("_", "-")
