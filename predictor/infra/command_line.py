"""Command lines that say what is wrong in one line."""

from __future__ import annotations

import argparse
import errno
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

# Imported before numpy, this limits the libraries to one thread in each process.
import predictor.infra.workers  # noqa: F401
from predictor.infra.errors import LineError, one_line

ENDLESS = 10**6
"""Upper bounds from this on are not named in error messages."""
DISK = (errno.ENOSPC, errno.EDQUOT, errno.EIO)
"""Errors of the disk, not of what the user gave."""


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
        """Add --jobs, the number of worker processes; by default one a core."""
        self.add_argument(
            "--jobs",
            type=between(1, 10_000),
            default=os.cpu_count() or 1,
            metavar="N",
            help="worker processes (default: one for each core)",
        )

    def add_out(self, default: str, what: str, metavar: str = "FILE") -> None:
        """Add --out, the file or folder of the results."""
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
        low: least value; an int makes the argument one.
        high: greatest value.
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
    """Do a command's work, and return its exit status.

    Args:
        name: of the command, which begins each line about an error.
        work: returns the exit status, or None for 0.

    Returns:
        What the work returns; 2 after an error of the input or of a file, 1 after an error of the
        disk, such as a full one, 130 after Ctrl-C.
    """
    try:
        status = work() or 0
        sys.stdout.flush()
        return status
    except LineError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:
        # The program that read the output has ended, such as `head`.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        print(f"{name}: {one_line(error)}; what was finished is kept", file=sys.stderr)
        return 1 if error.errno in DISK else 2
    except KeyboardInterrupt:
        print(f"{name}: interrupted; the same command goes on where it was", file=sys.stderr)
        return 130
