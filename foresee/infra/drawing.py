"""What all figures share: style, empty figures, and files of them."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from foresee.infra.atomic_file import write_whole

# Rows of maps run upwards, cells stay sharp, and legends have no frame.
matplotlib.rcParams.update(
    {"image.origin": "lower", "image.interpolation": "nearest", "legend.frameon": False}
)

INK = "#333333"
"""Colour of text and thin lines."""


def new_figure(width: float, height: float, maps: bool = False) -> Figure:
    """Return an empty figure that needs no window system.

    Args:
        width: width of the figure [inch].
        height: height of the figure [inch].
        maps: whether its panels have a fixed aspect ratio and should be close together.
    """
    layout: Literal["compressed", "constrained"] = "compressed" if maps else "constrained"
    return Figure(figsize=(width, height), dpi=150, layout=layout)


def bare(ax: Axes) -> None:
    """Format the axes of a map: no ticks, a thin frame, the same scale along x and y."""
    ax.set(aspect="equal", xticks=[], yticks=[])
    ax.spines[:].set(color="#AAAAAA", linewidth=0.8)


def save_figures(figures: Sequence[tuple[str, Callable[[], Figure]]], out: Path) -> list[Path]:
    """Draw figures, and save them as PNG files once all of them are drawn; return their paths.

    Args:
        figures: name of each file, and function that draws the figure.
        out: folder for the files; made if it is missing.
    """
    out.mkdir(parents=True, exist_ok=True)
    drawn = {out / name: io.BytesIO() for name, _ in figures}
    for data, (_, draw) in zip(drawn.values(), figures, strict=True):
        draw().savefig(data, format="png")
    for path, data in drawn.items():
        write_whole(path, data.getvalue())
    return list(drawn)
