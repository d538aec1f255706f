"""Print a script with which a shell completes the commands and their options.

    foresee completion bash > ~/.local/share/bash-completion/completions/foresee

It needs the package shtab: pip install 'foresee-nav[completion]'.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from dataclasses import dataclass

from foresee.infra.command_line import Command, UsageError
from foresee.infra.options import Options, argument

SHELLS = ("bash", "zsh", "tcsh")


@dataclass(frozen=True)
class Completion(Options):
    """For which shell."""

    shell: str = argument("the shell: bash, zsh or tcsh", "SHELL")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.shell not in SHELLS:
            raise UsageError(f"SHELL is {self.shell!r}: it must be bash, zsh or tcsh")


def _run(settings: Completion) -> None:
    try:
        import shtab
    except ImportError:
        raise UsageError(
            "the package shtab is missing: pip install 'foresee-nav[completion]'"
        ) from None
    from foresee.__main__ import commands

    root = argparse.ArgumentParser("foresee")
    of_commands = root.add_subparsers()
    for name, (module, summary) in commands().items():
        command: Command = importlib.import_module(module).main
        of_commands.add_parser(name, parents=[command.parser()], add_help=False, help=summary)
    print(shtab.complete(root, settings.shell))


main = Command("foresee.completion", __doc__, _run, resumes=False)

if __name__ == "__main__":
    sys.exit(main())
