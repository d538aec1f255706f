"""Settings classes whose fields are command-line options with default, limits and help."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable
from dataclasses import MISSING, Field, dataclass, field, fields
from numbers import Real
from pathlib import Path
from types import UnionType
from typing import Any, Self, get_args, get_origin, get_type_hints

from foresee.infra.command_line import UsageError


def option(
    default: Any,
    help: str,
    metavar: str | None = None,
    *,
    low: float | None = None,
    high: float = math.inf,
    choices: tuple[Any, ...] | None = None,
    parse: Callable[[str], Any] | None = None,
) -> Any:
    """Declare a field of a subclass of `Options` that is a command-line option.

    The type of the field is that of the value: a bool makes a flag, a tuple an option of one or
    more words, or of as many as the tuple has types.

    Args:
        default: default value; `dataclasses.MISSING` if the option must be given.
        help: description of the setting, for --help and for readers of the code. The default value
            is appended, unless the description says "(default: …)" itself.
        metavar: placeholder of the value in the help; of a tuple with a fixed number of words, one
            placeholder for each.
        low: smallest number allowed.
        high: largest number allowed.
        choices: values allowed.
        parse: function from a word to the value; by default the type of the field.
    """
    metadata = {"help": help, "metavar": metavar, "choices": choices, "parse": parse}
    return field(default=default, metadata=metadata | {"low": low, "high": high})


def argument(help: str, metavar: str) -> Any:
    """Declare a field that is a positional argument; of a tuple, one or more words.

    Args:
        help: description for --help and for readers of the code.
        metavar: name of the argument in the help.
    """
    return field(metadata={"help": help, "metavar": metavar, "positional": True})


def jobs_option() -> Any:
    """Declare --jobs, the number of worker processes; by default one for each core."""
    text = "worker processes (default: one for each core)"
    return option(os.cpu_count() or 1, text, "N", low=1, high=10_000)


def given(**values: Any) -> dict[str, Any]:
    """Return the values of options that were given: all that are not None."""
    return {name: value for name, value in values.items() if value is not None}


@dataclass(frozen=True)
class Options:
    """Base class of settings that are read from a command line.

    Fields that are declared with `option` or `argument` are options of the command; others are not.

    Raises:
        UsageError: if a value is not a number where limits are given, lies outside of them, or is
            not among the choices.
    """

    def __post_init__(self) -> None:
        for setting in fields(self):
            value, metadata = getattr(self, setting.name), setting.metadata
            values = value if isinstance(value, tuple) else () if value is None else (value,)
            choices = metadata.get("choices")
            if choices and not set(values) <= set(choices):
                allowed = ", ".join(map(str, choices))
                raise UsageError(f"{_flag(setting)} is {value}, it must be of {allowed}")
            low, high = metadata.get("low"), metadata.get("high", math.inf)
            if low is not None and not all(isinstance(number, Real) for number in values):
                raise UsageError(f"{_flag(setting)} is {value!r}, it must be a number")
            for number in values if low is not None else ():
                if not low <= number <= high:
                    wanted = f"lie between {low} and {high}"
                    wanted = f"be at least {low}" if high == math.inf else wanted
                    raise UsageError(f"{_flag(setting)} is {number}, it must {wanted}")

    @classmethod
    def add_to(cls, parser: argparse._ActionsContainer, *names: str) -> None:
        """Add the options to a parser or to an argument group.

        Args:
            parser: parser or group to which the options are added.
            names: names of the fields to add; all if none is given.
        """
        types = get_type_hints(cls)
        for setting in fields(cls):
            if "help" in setting.metadata and (not names or setting.name in names):
                _add(parser, setting, types[setting.name])

    @classmethod
    def of(cls, args: argparse.Namespace, *names: str) -> Self:
        """Make the settings from the parsed arguments of a command line.

        Args:
            args: parsed arguments.
            names: names of the fields to take from them; all if none is given.
        """
        return cls(**cls.parsed(args, *names))

    @classmethod
    def parsed(cls, args: argparse.Namespace, *names: str) -> dict[str, Any]:
        """Return the settings that a command line gives, by name; arguments as in `of`."""
        wanted = [f.name for f in fields(cls) if not names or f.name in names]
        found = {name: getattr(args, name) for name in wanted if hasattr(args, name)}
        return {k: tuple(v) if isinstance(v, list) else v for k, v in found.items()}

    def changed(self) -> list[str]:
        """Return the options, such as "--v-max", whose values are not their defaults."""
        return [_flag(f) for f in fields(self) if getattr(self, f.name) != f.default]


def _add(parser: argparse._ActionsContainer, setting: Field[Any], hint: Any) -> None:
    """Add the option of a field with a type such as int, `Path | None` or `tuple[str, ...]`."""
    metadata, default, text = setting.metadata, setting.default, setting.metadata["help"]
    if isinstance(default, bool):
        parser.add_argument(_flag(setting), action="store_true", help=text)
        return
    parse = metadata.get("parse")
    words: dict[str, Any] = {"metavar": metadata["metavar"], "choices": metadata.get("choices")}
    hint = get_args(hint)[0] if get_origin(hint) is UnionType else hint
    kinds = get_args(hint) or (hint,)
    words["type"] = parse or (_path if kinds[0] is Path else kinds[0])
    if get_origin(hint) is tuple and not parse:
        words["nargs"] = "+" if kinds[-1] is Ellipsis else len(kinds)
    if isinstance(words.get("nargs"), int):
        words["metavar"] = tuple(metadata["metavar"].split())
    if "positional" in metadata:
        parser.add_argument(setting.name, help=text, **words)
        return
    if default not in (None, (), MISSING) and "(default: " not in text:
        values = default if isinstance(default, tuple) else (default,)
        text += f" (default: {(',' if parse else ' ').join(map(str, values))})"
    # What is not given is absent from the parsed arguments: `of` then takes the field's default.
    words |= {"default": argparse.SUPPRESS, "required": default is MISSING}
    parser.add_argument(_flag(setting), help=text, **words)


def _path(word: str) -> Path:
    """Return the path that a word names."""
    if not word:
        # Path("") would be the working folder.
        raise argparse.ArgumentTypeError("the path is empty; the working folder is .")
    if "\0" in word:
        raise argparse.ArgumentTypeError("a path cannot hold the character NUL")
    return Path(word)


def _flag(setting: Field[Any]) -> str:
    return (
        setting.name if "positional" in setting.metadata else f"--{setting.name.replace('_', '-')}"
    )
