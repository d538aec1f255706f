"""What all figures share: colours, maps as images, lines coloured by speed."""

from __future__ import annotations

import itertools
import math
from functools import cache
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from predictor.mapping.body import Body
from predictor.mapping.grid import FREE, OCCUPIED, GridFrame

ARM_COLOURS = {
    "known": "#0072B2",
    "known+route": "#56B4E9",
    "predicted": "#D55E00",
    "optimistic": "#CC79A7",
    "oracle": "#009E73",
    "full": "#4D4D4D",
}
"""After Okabe & Ito 2008, safe for the colour-blind."""
OTHER_ARM = "#E69F00"
"""An arm without a colour of its own."""

PREDICTOR_COLOURS = {
    "unet_ff": "#0072B2",
    "resnet_ff": "#56B4E9",
    "gan": "#CC79A7",
    "mlp": "#B8A000",
    "compact": "#D55E00",
    "extend": "#009E73",
    "copy": "#222222",
    "grey": "#999999",
    "none": "#6B5B4B",
}
"""The same source, darkened where a line would be lost on white."""
OTHER_PREDICTORS = ("#E69F00", "#882255", "#44AA99", "#332288")
"""Those without a colour of their own, in turn; after P. Tol's `muted` scheme."""
_TURNS = itertools.cycle(OTHER_PREDICTORS)

LIMIT_COLOURS = {
    "top speed": "#44BB99",
    "acceleration": "#99DDFF",
    "turn": "#EEDD88",
    "unseen space": "#EE8866",
    "obstacle": "#77AADD",
    "path": "#BBCC33",
    "goal": "#DDDDDD",
    "emergency": "#222222",
}
"""After P. Tol's `light` scheme for filled areas, in the order of legends."""

FREE_COLOUR, OCCUPIED_COLOUR, UNKNOWN_COLOUR = "#FFFFFF", "#222222", "#D9D9D9"
RELIED_COLOUR = "#FDBE85"
"""Not seen, but relied upon."""
INK = "#333333"
"""Text and thin lines."""

SPEED_COLOURS = LinearSegmentedColormap.from_list(
    "speed", ["#0D0887", "#7E03A8", "#CC4778", "#F0823F", "#F2A52B"]
)
"""Plasma without its yellow, which is lost on white."""

OUTCOME_MARKS = {"reached": "o", "collided": "X", "timed_out": "s", "stuck": "D"}
"""At the end of a drive."""


def new_figure(width: float, height: float, maps: bool = False, dpi: int = 150) -> Figure:
    """Return an empty figure that needs no window system.

    Args:
        width: [inch].
        height: [inch].
        maps: whether its panels keep their aspect, and shall stand close together.
        dpi: dots per inch.
    """
    layout: Literal["compressed", "constrained"] = "compressed" if maps else "constrained"
    return Figure(figsize=(width, height), dpi=dpi, layout=layout)


def arm_colour(arm: str) -> str:
    """Return the colour of an arm, the same in every figure."""
    return ARM_COLOURS.get(arm, OTHER_ARM)


@cache
def predictor_colour(name: str) -> str:
    """Return the colour of a predictor, the same in every figure of a run."""
    if name in PREDICTOR_COLOURS:
        return PREDICTOR_COLOURS[name]
    return next(_TURNS)


def limit_colour(limit: str) -> str:
    """Return the colour of what limited the speed."""
    return LIMIT_COLOURS.get(limit, "#FFFFFF")


def map_image(cells: NDArray[np.int8], largest: int = 1200) -> NDArray[np.float64]:
    """Return a map as colours, (rows, columns, 3).

    Args:
        cells: as in `predictor.Grid`.
        largest: side above which it is shrunk, so that walls one cell thin stay visible.
    """
    cells = shrink(cells, math.ceil(max(cells.shape) / largest))
    image = np.empty((*cells.shape, 3))
    image[:] = to_rgb(UNKNOWN_COLOUR)
    image[cells == FREE] = to_rgb(FREE_COLOUR)
    image[cells == OCCUPIED] = to_rgb(OCCUPIED_COLOUR)
    return image


def shrink(cells: NDArray[np.int8], factor: int) -> NDArray[np.int8]:
    """Return a coarser map: blocks of cells take their largest value, so walls remain."""
    if factor <= 1:
        return cells
    rows, cols = (math.ceil(n / factor) for n in cells.shape)
    padded = np.full((rows * factor, cols * factor), -1, dtype=cells.dtype)
    padded[: cells.shape[0], : cells.shape[1]] = cells
    blocks = padded.reshape(rows, factor, cols, factor)
    return np.asarray(blocks.max(axis=(1, 3)))


def extent(frame: GridFrame) -> tuple[float, float, float, float]:
    """Return left, right, bottom, top of a frame [m], as images want them."""
    (x, y), (width, height) = frame.origin, frame.size
    return x, x + width, y, y + height


def draw_image(ax: Axes, image: NDArray[Any], frame: GridFrame) -> None:
    """Lay an image of a frame's cells into metric axes; it may be coarser than the frame."""
    left, right, bottom, top = extent(frame)
    factor = math.ceil(frame.shape[0] / image.shape[0])
    right = left + image.shape[1] * factor * frame.resolution
    top = bottom + image.shape[0] * factor * frame.resolution
    ax.imshow(image, origin="lower", extent=(left, right, bottom, top), interpolation="nearest")


def speed_line(
    ax: Axes, points: NDArray[Any], speed: NDArray[Any], v_max: float, width: float = 2.0
) -> LineCollection:
    """Draw a line through points (n, 2), each segment coloured by its mean speed."""
    # A white rim sets the line off from whatever lies beneath.
    ax.plot(*points.T, color="white", linewidth=width + 1.5, solid_capstyle="round", zorder=4)
    segments = np.stack([points[:-1], points[1:]], axis=1)
    line = LineCollection(
        list(segments),
        cmap=SPEED_COLOURS,
        norm=Normalize(0, v_max),
        linewidths=width,
        zorder=5,
        capstyle="round",
    )
    line.set_array(np.abs(speed[:-1] + speed[1:]) / 2)
    ax.add_collection(line)
    return line


def body_outline(pose: NDArray[Any], body: Body) -> NDArray[np.float64]:
    """Return the corners of the body at x, y, yaw, (4, 2) [m]."""
    corner = np.array([body.half_length, body.half_width])
    local = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * corner
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return np.asarray(local @ np.array([[cos, sin], [-sin, cos]]) + pose[:2], dtype=np.float64)


def draw_body(ax: Axes, pose: NDArray[Any], body: Body, colour: str) -> Polygon:
    """Draw the car, and return its shape."""
    patch = Polygon(
        body_outline(pose, body), facecolor=colour, edgecolor="white", linewidth=0.8, zorder=6
    )
    ax.add_patch(patch)
    return patch


def scale_bar(ax: Axes, length: float) -> None:
    """Draw a bar of a length [m] in the lower left corner, in place of axes' numbers."""
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    x, y = left + 0.04 * (right - left), bottom + 0.05 * (top - bottom)
    ax.plot([x, x + length], [y, y], color="white", linewidth=5, solid_capstyle="butt", zorder=8)
    ax.plot([x, x + length], [y, y], color=INK, linewidth=2.5, solid_capstyle="butt", zorder=9)
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.8}
    ax.annotate(
        f"{length:g} m",
        (x + length / 2, y),
        (0, 5),
        textcoords="offset points",
        ha="center",
        fontsize=8,
        color=INK,
        zorder=9,
        bbox=box,
    )


def bare(ax: Axes) -> None:
    """Strip a map's axes: no numbers, a thin frame, the same scale along x and y."""
    ax.set_aspect("equal")
    ax.set_xticks([])
    ax.set_yticks([])
    for spine in ax.spines.values():
        spine.set_color("#AAAAAA")
        spine.set_linewidth(0.8)
