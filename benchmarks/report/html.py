"""Parts of a page in HTML: texts and tables that are Markdown elsewhere."""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape


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
