"""Common elements of the figures of drives: colours, legends, maps, lines coloured by speed."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize, to_hex, to_rgb
from matplotlib.image import AxesImage
from matplotlib.patches import Patch, Polygon
from matplotlib.text import Annotation
from numpy.typing import NDArray
from skimage.measure import block_reduce

from benchmarks.runs.arms import arm_kind, arm_risk
from foresee.infra.drawing import INK
from foresee.mapping.body import Body
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame

ARM_COLOURS = {
    "known": "#0072B2",
    "known+route": "#56B4E9",
    "known+truth10": "#DDCC77",
    "known+truth20": "#AA7744",
    "known+truth40": "#774411",
    "backup": "#999933",
    "predicted": "#D55E00",
    "known+frontiers": "#332288",
    "known+route+frontiers": "#882255",
    "optimistic": "#CC79A7",
    "perfect": "#66CCAA",
    "oracle": "#009E73",
    "full": "#4D4D4D",
}
"""Arm → colour; after Okabe & Ito 2008, safe for the colour-blind."""
OTHER_ARM = "#E69F00"
"""Colour of an arm that has none of its own."""

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
"""Limit of the speed → colour, in the order of legends; after P. Tol's `light` scheme for areas."""

FREE_COLOUR, OCCUPIED_COLOUR, UNKNOWN_COLOUR = "#FFFFFF", "#222222", "#D9D9D9"
RELIED_COLOUR = "#FDBE85"
"""Colour of unobserved cells that the plan relies on."""
CRASH_COLOUR = "#C00000"
RIM: dict[str, Any] = {"edgecolor": "#888888", "linewidth": 0.5}
"""Style of the rim of a legend's entry for a pale area."""

SPEED_COLOURS = LinearSegmentedColormap.from_list(
    "speed", ["#0D0887", "#7E03A8", "#CC4778", "#F0823F", "#F2A52B"]
)
"""Colour map of speed: `plasma` without its yellow, which is hard to see on white."""

OUTCOME_MARKS = {"reached": "o", "collided": "X", "timed_out": "s", "stuck": "D"}
"""Outcome → marker at the end of a drive in diagrams."""
MARKS: dict[str, dict[str, Any]] = {
    name: {
        "marker": marker,
        "color": colour,
        "markersize": size,
        "markeredgecolor": "white",
        "linestyle": "none",
        "zorder": 7,
    }
    for name, marker, colour, size in (
        ("start", "o", "#0072B2", 7),
        ("goal", "*", "#009E73", 13),
        ("change of gear", "D", INK, 5),
        ("collision", "X", CRASH_COLOUR, 11),
        ("stuck or timed out", "s", INK, 7),
    )
}
"""Name in the legend → style of a marker on a map."""
DASHED = (0, (4, 2))
LEGEND: dict[str, Any] = {"fontsize": 8, "handlelength": 1.2, "columnspacing": 1.0}
"""Style of small legends."""


def arm_colour(arm: str) -> str:
    """Return the colour of an arm, the same in every figure; at a higher risk it is darker."""
    colour, share = ARM_COLOURS.get(arm_kind(arm), OTHER_ARM), arm_risk(arm)
    if share == 0.0:
        return colour
    red, green, blue = (part * (0.75 - 0.5 * share / (share + 0.05)) for part in to_rgb(colour))
    return to_hex((red, green, blue))


def limit_colour(limit: str) -> str:
    """Return the colour of what limited the speed."""
    return LIMIT_COLOURS.get(limit, "#FFFFFF")


def limit_patches(limits: Iterable[str], **style: Any) -> list[Patch]:
    """Return the legend's entries for the limits of the speed that occur.

    Args:
        limits: names of limits, with repetitions.
        style: further arguments of `Patch`.
    """
    used = set(limits)
    order = [limit for limit in LIMIT_COLOURS if limit in used] + sorted(used - set(LIMIT_COLOURS))
    return [Patch(facecolor=limit_colour(limit), label=limit, **style) for limit in order]


def swatch(colour: str, label: str) -> Patch:
    """Return a legend's entry for an area."""
    return Patch(facecolor=colour, label=label, **RIM)


def note(
    ax: Axes, text: str, at: tuple[float, float], shift: Any = (0, 0), **style: Any
) -> Annotation:
    """Write a text at a point, shifted by some points to the right and up.

    Args:
        ax: axes to write in.
        text: text.
        at: x, y of the point, by default in data coordinates.
        shift: shift along x and y [pt].
        style: further arguments of `Axes.annotate`.
    """
    defaults: dict[str, Any] = {"textcoords": "offset points", "fontsize": 8, "color": INK}
    return ax.annotate(text, at, shift, **defaults | style)


def map_image(cells: NDArray[np.int8], largest: int = 1200) -> NDArray[np.float64]:
    """Return the image of a map, (rows, columns, 3).

    Args:
        cells: values of the cells, as in `foresee.mapping.grid.Grid`.
        largest: longest side of the image [pixels]; a larger map is shrunk so that thin walls stay
            visible.
    """
    cells = shrink(cells, math.ceil(max(cells.shape) / largest))
    image = np.empty((*cells.shape, 3))
    image[:] = to_rgb(UNKNOWN_COLOUR)
    image[cells == FREE] = to_rgb(FREE_COLOUR)
    image[cells == OCCUPIED] = to_rgb(OCCUPIED_COLOUR)
    return image


def shrink(cells: NDArray[np.int8], factor: int) -> NDArray[np.int8]:
    """Return a coarser map, in which each block of cells has its largest value, so that walls stay.

    Args:
        cells: values of the cells, (rows, columns).
        factor: side of a block [cells].
    """
    return np.asarray(block_reduce(cells, factor, np.max, cval=UNKNOWN))


def extent(frame: GridFrame) -> tuple[float, float, float, float]:
    """Return left, right, bottom and top of a frame [m], as the argument `extent` of `imshow`."""
    (x, y), (width, height) = frame.origin, frame.size
    return x, x + width, y, y + height


def draw_image(ax: Axes, image: NDArray[Any], frame: GridFrame) -> AxesImage:
    """Draw an image of a frame's cells into axes in metres; it may be coarser than the frame."""
    left, _, bottom, _ = extent(frame)
    step = math.ceil(frame.shape[0] / image.shape[0]) * frame.resolution
    height, width = image.shape[0] * step, image.shape[1] * step
    return ax.imshow(image, extent=(left, left + width, bottom, bottom + height))


def outline(ax: Axes, truth: Grid, colour: str, width: float, zorder: float = 2) -> None:
    """Draw the outline of a map's free space."""
    free = truth.free.astype(float)
    ax.contour(
        *truth.frame.centres(), free, [0.5], colors=[colour], linewidths=width, zorder=zorder
    )


def speed_line(ax: Axes, v_max: float, width: float) -> LineCollection:
    """Add an empty line to axes, and return it; `set_line` gives it points and colours.

    Args:
        ax: axes.
        v_max: speed at the end of the colour map [m/s].
        width: width of the line [pt].
    """
    line = LineCollection(
        [],
        cmap=SPEED_COLOURS,
        norm=Normalize(0, v_max),
        linewidths=width,
        zorder=5,
        capstyle="round",
    )
    ax.add_collection(line)
    return line


def set_line(line: LineCollection, points: NDArray[Any], speed: NDArray[Any]) -> None:
    """Set the points (n, 2) of a line, and colour each segment by its mean speed.

    Args:
        line: line that `speed_line` has made.
        points: points, (n, 2).
        speed: speed at each point, (n,) [m/s].
    """
    line.set_segments(list(np.stack([points[:-1], points[1:]], axis=1)))
    line.set_array(np.abs(speed[:-1] + speed[1:]) / 2)


def draw_speed(
    ax: Axes, points: NDArray[Any], speed: NDArray[Any], v_max: float, width: float
) -> LineCollection:
    """Draw a line through points (n, 2), coloured by speed."""
    # A white rim separates the line from what is drawn beneath it.
    ax.plot(*points.T, color="white", linewidth=width + 1.5, solid_capstyle="round", zorder=4)
    line = speed_line(ax, v_max, width)
    set_line(line, points, speed)
    return line


def body_outline(pose: NDArray[Any], body: Body) -> NDArray[np.float64]:
    """Return the corners of the car's body at x, y, yaw, (4, 2) [m]."""
    corner = np.array(body.halves)
    local = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * corner
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return np.asarray(local @ np.array([[cos, sin], [-sin, cos]]) + pose[:2], dtype=np.float64)


def draw_body(ax: Axes, pose: NDArray[Any], body: Body, arm: str) -> Polygon:
    """Draw the car in an arm's colour, and return its shape."""
    style: dict[str, Any] = {"edgecolor": "white", "linewidth": 0.8, "zorder": 6}
    patch = Polygon(body_outline(pose, body), facecolor=arm_colour(arm), **style)
    ax.add_patch(patch)
    return patch


def scale_bar(ax: Axes, length: float | None = None) -> None:
    """Draw a scale bar in the lower left corner of a map.

    Args:
        ax: axes whose limits are set already.
        length: length of the bar [m]; None: 5 m, or 10 m if the map is wider than 25 m.
    """
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    length = length or (10.0 if right - left > 25 else 5.0)
    x, y = left + 0.04 * (right - left), bottom + 0.05 * (top - bottom)
    for colour, width, zorder in (("white", 5, 8), (INK, 2.5, 9)):
        style: dict[str, Any] = {"solid_capstyle": "butt", "zorder": zorder}
        ax.plot([x, x + length], [y, y], color=colour, linewidth=width, **style)
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.8}
    note(ax, f"{length:g} m", (x + length / 2, y), (0, 5), ha="center", zorder=9, bbox=box)
