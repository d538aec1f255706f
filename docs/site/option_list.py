"""The options of a command as HTML, from its parser, in place of a block `foresee NAME --help`.

`zensical.toml` names the function as the format of blocks in the language `options`. Elsewhere, as
on a repository's host, such a block shows the command that prints the same.
"""

from __future__ import annotations

import argparse
import importlib
from html import escape
from textwrap import dedent
from typing import Any

from foresee.__main__ import commands
from foresee.infra.command_line import Command


def option_list(source: str, *_: Any, **__: Any) -> str:
    """Return the description of a command, and a list of its options for each of its groups.

    Args:
        source: `foresee NAME --help`.

    Raises:
        ValueError: if there is no such command.
    """
    words = source.split()
    if len(words) != 3 or (words[0], words[2]) != ("foresee", "--help"):
        raise ValueError(f"{source!r} is not of the form: foresee NAME --help")
    name = words[1]
    if name not in commands():
        raise ValueError(f"{source!r}: there is no such command")
    command: Command = importlib.import_module(commands()[name][0]).main
    parser = command.parser()
    parts = [_description(parser.description or "")]
    for group in parser._action_groups:
        actions = [action for action in group._group_actions if action.dest != "help"]
        if actions:
            parts.append(f"<p><strong>{escape((group.title or '').capitalize())}</strong></p>")
            parts.append(f"<dl>{''.join(_option(name, parser, action) for action in actions)}</dl>")
    return "\n".join(parts)


def _description(text: str) -> str:
    """Return paragraphs; an indented one is code."""
    paragraphs = [part.strip("\n") for part in text.split("\n\n")]
    return "\n".join(
        f"<pre><code>{escape(dedent(part))}</code></pre>"
        if part.startswith(" ")
        else f"<p>{escape(part)}</p>"
        for part in paragraphs
    )


def _option(command: str, parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    """Return an option as argparse words it, with an anchor such as `corridor--v-max`."""
    formatter = parser._get_formatter()
    flag = action.option_strings[-1] if action.option_strings else f"--{action.dest}"
    anchor = escape(f"{command}{flag}")
    usage = escape(formatter._format_action_invocation(action))
    meaning = escape(formatter._expand_help(action))
    return f'<dt id="{anchor}"><code>{usage}</code></dt><dd>{meaning}</dd>'
