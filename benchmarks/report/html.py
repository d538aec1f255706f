"""Parts of a page in HTML: texts and tables that are Markdown elsewhere, and figures."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from html import escape

from matplotlib import rc_context
from matplotlib.figure import Figure


def inline(text: str) -> str:
    """Return a line of Markdown with `code` and **strong** words as HTML."""
    text = re.sub(r"`([^`]*)`", r"<code>\1</code>", escape(text))
    text = re.sub(r"\*\*(.+?)\*\*", r"<strong>\1</strong>", text)
    return re.sub(r"\\([*|])", r"\1", text)


def table(rows: Sequence[Sequence[str]]) -> str:
    """Return a table whose first row is the head; its cells are HTML."""
    first, *others = rows
    head = "".join(f'<th scope="col">{cell}</th>' for cell in first)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>\n" for row in others)
    return f'<div class="scrolls"><table>\n<tr>{head}</tr>\n{body}</table></div>'


def picture(figure: Figure, words: str) -> str:
    """Return a figure as inline SVG.

    Args:
        figure: figure; its texts stay texts.
        words: the same in words, for readers who cannot see it.
    """
    data = io.StringIO()
    # The names of its parts are the same each time.
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "report"}):
        figure.savefig(data, format="svg", metadata={"Date": None})
    svg = data.getvalue()
    svg = svg[svg.index("<svg") :]
    return svg.replace("<svg", f'<svg role="img" aria-label="{escape(words)}"', 1)
