"""Command lines that report each error in one line."""

from __future__ import annotations

import argparse
import errno
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

# Imported before numpy, this limits the libraries to one thread in each process.
import foresee.infra.workers  # noqa: F401
from foresee.infra.errors import LineError, one_line

ENDLESS = 10**6
"""Upper bounds at or above this are not named in error messages."""
DISK = (errno.ENOSPC, errno.EDQUOT, errno.EIO)
"""Error numbers that the disk causes, not the user's input."""


class UsageError(LineError):
    """An argument that cannot be used; the message is one line."""


class OneLineParser(argparse.ArgumentParser):
    """A parser that raises its errors, so that `run_command` prints them in one line."""

    def error(self, message: str) -> NoReturn:
        """Refuse the arguments.

        Raises:
            UsageError: always.
        """
        raise UsageError(message)

    def add_jobs(self) -> None:
        """Add --jobs, the number of worker processes; by default one for each core."""
        self.add_argument(
            "--jobs",
            type=between(1, 10_000),
            default=os.cpu_count() or 1,
            metavar="N",
            help="worker processes (default: one for each core)",
        )

    def add_out(self, default: str, what: str, metavar: str = "FILE") -> None:
        """Add --out, the file or folder of the results.

        Args:
            default: default path.
            what: description for the help.
            metavar: placeholder of the path in the help, "FILE" or "DIR".
        """
        self.add_argument(
            "--out",
            type=Path,
            default=Path(default),
            metavar=metavar,
            help=f"{what} (default: %(default)s)",
        )


def between(low: float, high: float) -> Callable[[str], Any]:
    """Return a converter for `add_argument(type=…)` that refuses numbers outside of a range.

    Args:
        low: smallest value; its type, int or float, is that of the argument.
        high: largest value.
    """
    kind = type(low)

    def convert(text: str) -> Any:
        try:
            value = kind(text)
        except ValueError:
            what = "whole number" if kind is int else "number"
            raise argparse.ArgumentTypeError(f"{text!r} is no {what}") from None
        if not low <= value <= high:
            wanted = f"at least {low}" if high >= ENDLESS else f"between {low} and {high}"
            raise argparse.ArgumentTypeError(f"{text} is not {wanted}")
        return value

    return convert


def run_command(name: str, work: Callable[[], int | None]) -> int:
    """Run the work of a command, report its errors in one line, and return its exit status.

    Args:
        name: name of the command, with which each error message begins.
        work: function that does the work and returns the exit status; None counts as 0.

    Returns:
        The status that `work` returned; 2 after an error in the input or in a file, 1 after an
        error of the disk, such as a full disk, 130 after Ctrl-C.
    """
    try:
        status = work() or 0
        sys.stdout.flush()
        return status
    except LineError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:
        # The program that read the output, such as `head`, has ended.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        print(f"{name}: {one_line(error)}; what was finished is kept", file=sys.stderr)
        return 1 if error.errno in DISK else 2
    except KeyboardInterrupt:
        print(f"{name}: interrupted; the same command goes on where it stopped", file=sys.stderr)
        return 130
