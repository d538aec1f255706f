"""Command lines that say what is wrong in one line."""

from __future__ import annotations

import argparse

from predictor.infra.errors import shown


class UsageError(ValueError):
    """An argument that cannot be used; the message is one line."""

    def __init__(self, said: str) -> None:
        super().__init__(shown(said))


class OneLineParser(argparse.ArgumentParser):
    """Says what is wrong in one line, and exits with 2."""

    def error(self, message: str) -> None:  # type: ignore[override]
        """Print the line and exit."""
        self.exit(2, f"{self.prog}: {shown(message)}\n")
