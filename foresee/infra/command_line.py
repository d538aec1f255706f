"""Commands: parse their options, run them, and report each error in one line."""

from __future__ import annotations

import argparse
import errno
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, NoReturn, get_args, get_type_hints

# Imported before numpy, this limits the libraries to one thread in each process.
import foresee.infra.workers  # noqa: F401
from foresee.infra.errors import LineError, one_line, shown
from foresee.infra.streams import lasting_streams

DISK = (errno.ENOSPC, errno.EDQUOT, errno.EIO)
"""Error numbers that the disk causes, not the user's input."""


class UsageError(LineError):
    """An argument that cannot be used; the message is one line."""


@dataclass(frozen=True)
class Section:
    """How a command shows a settings class, for `Annotated[Settings, Section(…)]`.

    Attributes:
        heading: heading of its options in the help; "": they are among the general ones.
        names: fields that are options of the command; (): all.
        below: further heading → fields that are shown there instead, after those of `heading`.
    """

    heading: str = ""
    names: tuple[str, ...] = ()
    below: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def parts(self, settings: type[Any]) -> Iterator[tuple[str, tuple[str, ...]]]:
        """Yield each heading, and the names of the fields below it."""
        names = self.names or tuple(each.name for each in fields(settings))
        lower = {name for group in self.below.values() for name in group}
        yield self.heading, tuple(name for name in names if name not in lower)
        for heading, group in self.below.items():
            yield heading, tuple(name for name in group if name in names)


@dataclass(frozen=True)
class Command:
    """A command line: called with its words, it does its work and returns the exit status.

    Attributes:
        name: name of the command, with which each error message begins.
        description: text of the help; paragraphs that are indented keep their lines.
        run: function that does the work and returns the exit status; None counts as 0. Its
            parameters are annotated with the subclasses of `Options` that hold the options.
        resumes: whether the same command goes on where an interrupted one stopped.
    """

    name: str
    description: str | None
    run: Callable[..., int | None]
    resumes: bool = True

    def __call__(self, argv: list[str] | None = None) -> int:
        """Parse the options, run the command, and report its errors in one line.

        Args:
            argv: words of the command line; None: those of the process.

        Returns:
            The status that `run` returned; 2 after an error in the input or in a file, 1 after an
            error of the disk, such as a full disk, or the loss of worker processes, 130 after
            Ctrl-C.
        """
        with lasting_streams():
            return self._status(argv)

    def _status(self, argv: list[str] | None) -> int:
        try:
            status = self.run(*self._parsed(argv)) or 0
            sys.stdout.flush()
            return status
        except LineError as error:
            self._complain(str(error))
            return error.status
        except BrokenPipeError:
            # The program that read the output, such as `head`, has ended.
            return 1
        except OSError as error:
            where = "" if error.filename is None else f"{error.filename}: "
            kept = "; what was finished is kept" if self.resumes else ""
            self._complain(shown(f"{where}{one_line(error)}{kept}"))
            return 1 if error.errno in DISK else 2
        except KeyboardInterrupt:
            goes_on = "; the same command goes on where it stopped" if self.resumes else ""
            self._complain(f"interrupted{goes_on}")
            return 130

    def _complain(self, line: str) -> None:
        print(f"{self.name}: {line}", file=sys.stderr)

    def parser(self) -> argparse.ArgumentParser:
        """Return the parser of the options."""
        prog = f"{self.name} [options]"
        parser = _Parser(prog=prog, description=self.description, formatter_class=_Paragraphs)
        groups: dict[str, argparse._ActionsContainer] = {"": parser}
        for settings, section in self._parts():
            for heading, names in section.parts(settings):
                if names and heading not in groups:
                    groups[heading] = parser.add_argument_group(heading)
                if names:
                    settings.add_to(groups[heading], *names)
        return parser

    def _parts(self) -> list[tuple[Any, Section]]:
        """Return the settings class of each parameter of `run`, and how it is shown."""
        hints = get_type_hints(self.run, include_extras=True)
        hints.pop("return", None)
        # Settings with a section are annotated as (class, section).
        return [get_args(hint) or (hint, Section()) for hint in hints.values()]

    def _parsed(self, argv: list[str] | None) -> list[Any]:
        """Return an instance of the settings class of each parameter of `run`."""
        args = self.parser().parse_args(argv)
        return [settings.of(args, *section.names) for settings, section in self._parts()]


class _Parser(argparse.ArgumentParser):
    """A parser that raises its errors, so that `Command` prints them in one line."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(message)


class _Paragraphs(argparse.HelpFormatter):
    """A formatter that keeps the paragraphs of a description, and the lines of indented ones.

    The usage names only what must be given: a first screen has no room for all options twice.
    """

    def add_usage(self, usage: Any, actions: Any, groups: Any, prefix: str | None = None) -> None:
        super().add_usage(usage, [each for each in actions if each.required], groups, prefix)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        fill = super()._fill_text
        paragraphs = (part.strip("\n") for part in text.split("\n\n"))
        return "\n\n".join(
            part if part.startswith(" ") else fill(part, width, indent) for part in paragraphs
        )
