"""What all figures share: style, empty figures, and files of them.

Modules import this one before matplotlib, which it imports in any environment of the user.
"""

from __future__ import annotations

import contextlib
import io
import logging
import os
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from foresee.infra.atomic_file import write_whole
from foresee.infra.errors import shown
from foresee.infra.float_errors import usual_float_errors

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@contextmanager
def _any_environment() -> Iterator[None]:
    """Let matplotlib be imported whatever the user's environment is.

    A backend in MPLBACKEND that is not installed would be an error, as in a process that a notebook
    starts. Figures here need no backend; it is set afterwards, for other figures of the user.
    Without a home folder, matplotlib would report at length that it uses a temporary one.
    """
    backend, log = os.environ.pop("MPLBACKEND", None), logging.getLogger("matplotlib")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        log.setLevel(level)
        if backend is not None:
            os.environ["MPLBACKEND"] = backend
    if backend:
        with contextlib.suppress(ValueError):
            rcParams["backend"] = backend


with _any_environment():
    from matplotlib import font_manager, rcParams, style  # noqa: F401  The fonts use the folder.
    from matplotlib.figure import Figure

STYLE = {
    # Rows of maps run upwards, cells stay sharp, and legends have no frame.
    "image.origin": "lower",
    "image.interpolation": "nearest",
    "legend.frameon": False,
    # A "$" in a name is no formula.
    "text.parse_math": False,
}
INK = "#333333"
"""Colour of text and thin lines."""
LONGEST = 60
"""Length above which a name is cut [characters]."""


@contextmanager
def own_style() -> Iterator[None]:
    """Draw in the style of this project, whatever the user's settings of matplotlib and NumPy."""
    with style.context(["default", STYLE]), warnings.catch_warnings(), usual_float_errors():
        # A character that no font has is drawn as a box.
        warnings.filterwarnings("ignore", "Glyph .* missing from")
        yield


class OwnFigure(Figure):
    """A figure in the style of this project, which notebooks display without pyplot."""

    def draw(self, renderer: Any) -> None:
        """Draw the figure; some of its parts, such as ticks, are made only now."""
        with own_style():
            super().draw(renderer)

    def _repr_png_(self) -> bytes:
        data = io.BytesIO()
        self.savefig(data, format="png")
        return data.getvalue()


def new_figure(
    width: float,
    height: float,
    maps: bool = False,
    layout: Literal["constrained"] | None = "constrained",
) -> Figure:
    """Return an empty figure that needs no window system.

    Args:
        width: width of the figure [inch].
        height: height of the figure [inch].
        maps: whether its panels have a fixed aspect ratio and should be close together.
        layout: how matplotlib arranges other panels; None: they are arranged by hand.
    """
    return OwnFigure(figsize=(width, height), dpi=150, layout="compressed" if maps else layout)


def short_name(text: str) -> str:
    """Return a name of the user's as a figure shows it: in one line, and cut if it is long."""
    return shown(text, LONGEST)


def bare(ax: Axes) -> None:
    """Format the axes of a map: no ticks, a thin frame, the same scale along x and y."""
    ax.set(aspect="equal", xticks=[], yticks=[])
    ax.spines[:].set(color="#AAAAAA", linewidth=0.8)


@own_style()
def as_svg(figure: Figure, words: str) -> str:
    """Return a figure as an SVG element of a page, in which its texts stay texts.

    Args:
        figure: figure.
        words: what it shows, for readers who cannot see it.
    """
    data = io.StringIO()
    # The same figure gives the same text each time.
    with style.context({"svg.fonttype": "none", "svg.hashsalt": "figure"}):
        figure.savefig(data, format="svg", metadata={"Date": None})
    _, element, rest = data.getvalue().partition("<svg")
    return f'{element} role="img" aria-label="{escape(words)}"{rest}'


@own_style()
def save_figures(
    figures: Sequence[tuple[str, Callable[[], Figure | None]]], out: Path
) -> list[Path]:
    """Draw figures, and save them as PNG files once all of them are drawn; return their paths.

    Args:
        figures: name of each file, and function that draws the figure; None: there is nothing to
            draw, and no file.
        out: folder for the files; made if it is missing.
    """
    out.mkdir(parents=True, exist_ok=True)
    drawn = dict[Path, io.BytesIO]()
    for name, draw in figures:
        figure = draw()
        if figure is not None:
            figure.savefig(drawn.setdefault(out / name, io.BytesIO()), format="png")
    for path, data in drawn.items():
        write_whole(path, data.getvalue())
    return list(drawn)
