"""Maps as files, in the format of ROS map_server: a YAML file that names an image.

The meaning of pixels is that of nav2_map_server (`map_io.cpp`, since April 2025): thresholds are
inclusive, the shade is that of the colours alone, and a pixel that is not opaque is unknown. There
is one exception, see `SAVED`.
"""

from __future__ import annotations

import io
import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from reprlib import repr as short
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image

from foresee.infra import plain_yaml
from foresee.infra.atomic_file import write_whole
from foresee.infra.errors import LineError, one_line
from foresee.infra.float_errors import usual_float_errors
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from sim.world import World

MODES = ("trinary", "scale", "raw")
"""Modes of map_server, which say what a pixel's value means."""
MAX_CELLS = 64_000_000
"""Largest number of pixels of an image: at 0.05 m this is a square of 400 m."""
MAX_YAML = 20_000
"""Largest size of a YAML file [bytes]."""
MAX_METRES = 1e6
"""Largest coordinate of an origin, and coarsest resolution [m]."""
MOST_TURN = 0.1
"""Largest distance by which the yaw of an origin may move a cell [cells]; it then counts as 0."""
SAVED = {0, 205, 254, 255}
"""Shades that map savers write for occupied, unknown and free, and white. An image without others
tells what is unknown: its 205 stays unknown where the thresholds would make it free, as those of
Nav2's map saver (`free_thresh: 0.25`) do."""
WORDS = {"false": False, "no": False, "off": False, "true": True, "yes": True, "on": True}
PHOTOMETRIC = 262
"""Tag of a TIFF that says what its shades mean."""
FORMATS = ("PNG", "PPM", "BMP", "JPEG", "TIFF", "GIF")
"""Image formats that are read. For some others, such as EPS, Pillow starts other programs."""


class MapError(LineError):
    """A map that cannot be read or written; the message is one line that says why."""


@dataclass(frozen=True)
class MapFile:
    """The content of a map's YAML file.

    Attributes:
        image: path of the image.
        resolution: side of a cell [m].
        origin: x, y of the image's lower-left corner [m].
        yaw: turn of the image about that corner [rad]; `load_world` allows only a negligible one.
        negate: whether white means occupied; ignored in raw mode.
        occupied_thresh: share of black from which on a pixel is occupied, in [0, 1].
        free_thresh: share of black up to which a pixel is free, in [0, 1].
        mode: one of `MODES`.
    """

    image: Path
    resolution: float
    origin: tuple[float, float]
    yaw: float = 0.0
    negate: bool = False
    occupied_thresh: float = 0.65
    free_thresh: float = 0.196
    mode: str = "trinary"


@usual_float_errors()
def load_world(path: str | Path) -> World:
    """Read a map_server map; the world is named after the YAML file.

    Each cell becomes FREE, OCCUPIED or UNKNOWN. In scale mode, values between the thresholds become
    UNKNOWN; in raw mode, occupancies are compared with the file's thresholds, as nav2's map saver
    does.

    Args:
        path: path of the YAML file; the path of the image is relative to it.

    Raises:
        MapError: if the map cannot be read.
    """
    path = Path(path)
    meta = read_yaml(path)
    data = occupancy(_read_image(meta.image), meta)
    turn = abs(math.remainder(meta.yaw, math.tau))
    if turn * math.hypot(*data.shape) > MOST_TURN:
        raise MapError(
            f"{path}: origin has a yaw of {meta.yaw:g} rad, which is unsupported: turn the map"
        )
    free, occupied = FREE, OCCUPIED
    if meta.mode == "raw":
        free, occupied = round(100 * meta.free_thresh), round(100 * meta.occupied_thresh)
    cells = np.where(data >= occupied, np.int8(OCCUPIED), np.int8(UNKNOWN))
    cells[(data >= 0) & (data <= free)] = FREE
    rows, cols = data.shape
    return World(path.stem, Grid(GridFrame(meta.resolution, meta.origin, (rows, cols)), cells))


def save_world(world: World, path: str | Path) -> None:
    """Write a world as a map_server map: the YAML file and, beside it, a binary PGM.

    Each file appears whole or not at all, the YAML after the image that it names.

    Raises:
        MapError: if the files cannot be written.
    """
    path = Path(path)
    if path.suffix not in (".yaml", ".yml"):
        raise MapError(f"{path}: a map is saved under the name of its .yaml file")
    frame, cells = world.grid.frame, world.grid.cells[::-1]
    shades = np.choose((cells == OCCUPIED) + 2 * (cells == UNKNOWN), (254, 0, 205))
    image, encoded = path.with_suffix(".pgm"), io.BytesIO()
    Image.fromarray(shades.astype(np.uint8)).save(encoded, "PPM")
    facts = {
        "image": image.name,
        "mode": "trinary",
        "resolution": float(frame.resolution),
        "origin": [float(frame.origin[0]), float(frame.origin[1]), 0.0],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }
    try:
        write_whole(image, encoded.getvalue())
        write_whole(path, yaml.safe_dump(facts, sort_keys=False).encode())
    except OSError as error:
        raise MapError(f"{path}: cannot be written: {one_line(error)}") from error


def read_yaml(path: Path) -> MapFile:
    """Read and check a map's YAML file.

    Raises:
        MapError: if it is missing, broken or makes no sense.
    """
    try:
        said = plain_yaml.read_yaml(path, MAX_YAML)
    except (OSError, ValueError) as error:
        # Both broken YAML and a path that no file can have raise ValueError.
        raise MapError(f"{path}: cannot be read: {one_line(error)}") from error
    if not isinstance(said, dict):
        raise MapError(f"{path}: not a map_server file, it holds no keys")
    needed = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
    missing = [key for key in needed if key not in said]
    if missing:
        raise MapError(f"{path}: missing key {', '.join(missing)}")
    return _checked(path, said)


def _checked(path: Path, said: dict[Any, Any]) -> MapFile:
    """Check the values of a YAML file that has all needed keys."""
    image, mode, origin = said["image"], said.get("mode", "trinary"), said["origin"]
    if not isinstance(image, str) or not image or "\0" in image:
        raise MapError(f"{path}: image is {short(image)}, it must be a path")
    mode = "trinary" if mode is None else mode
    if not isinstance(mode, str) or mode.lower() not in MODES:
        raise MapError(f"{path}: mode is {short(mode)}, it must be one of {', '.join(MODES)}")
    if not isinstance(origin, list) or len(origin) != 3:
        raise MapError(f"{path}: origin is {short(origin)}, it must be [x, y, yaw]")
    x, y, yaw = (_number(path, "origin", value) for value in origin)
    resolution = _number(path, "resolution", said["resolution"])
    if not 1e-4 <= resolution <= MAX_METRES:
        raise MapError(f"{path}: resolution is {resolution} m, it must lie between 1e-4 and 1e6 m")
    if max(abs(x), abs(y)) > MAX_METRES:
        raise MapError(f"{path}: origin is {x}, {y} m, it must lie within {MAX_METRES:g} m")
    occupied = _number(path, "occupied_thresh", said["occupied_thresh"])
    free = _number(path, "free_thresh", said["free_thresh"])
    if not 0 <= free < occupied <= 1:
        raise MapError(
            f"{path}: free_thresh {free} and occupied_thresh {occupied} "
            "must satisfy 0 <= free_thresh < occupied_thresh <= 1"
        )
    negate = _flag(path, "negate", said["negate"])
    place = path.parent / image
    return MapFile(place, resolution, (x, y), yaw, negate, occupied, free, mode.lower())


def occupancy(pixels: NDArray[np.unsignedinteger], meta: MapFile) -> NDArray[np.int8]:
    """Return the occupancies of an image as in nav_msgs/OccupancyGrid: 0–100, or −1 for unknown.

    Row 0 of the result has the lowest y.

    Args:
        pixels: pixels of the image, top row first, (height, width, channels) uint8 or uint16. One
            or three channels are colours; a second or fourth one is alpha.
        meta: mode, thresholds and negation.
    """
    height, width, channels = pixels.shape
    data = np.empty((height, width), dtype=np.int8)
    full = np.iinfo(pixels.dtype).max
    # Strip by strip, since the arithmetic takes many times the memory of the image.
    for top in range(0, height, 256):
        data[top : top + 256] = _strip(pixels[top : top + 256] / full, meta)
    colours = pixels[:, :, : channels - (channels in (2, 4))]
    if meta.mode == "trinary" and full == 255 and set(np.unique(colours)) <= SAVED:
        data[(colours == 205).all(axis=2)] = UNKNOWN
    return np.ascontiguousarray(data[::-1])


def _strip(pixels: NDArray[np.float64], meta: MapFile) -> NDArray[np.float64]:
    """Return the occupancies of some rows of pixels in [0, 1], top row first."""
    alpha = pixels.shape[2] in (2, 4)
    shade = (pixels[:, :, :-1] if alpha else pixels).mean(axis=2)
    if meta.mode == "raw":
        value = np.round(255 * shade)
        return np.where(value <= 100, value, UNKNOWN)
    # Rounded, so that a shade equal to a threshold, such as 0.8 = 204/255, is on its side.
    black = np.round(shade if meta.negate else 1.0 - shade, 12)
    between = np.full(black.shape, float(UNKNOWN))
    if meta.mode == "scale":
        ratio = (black - meta.free_thresh) / (meta.occupied_thresh - meta.free_thresh)
        # 0 and 100 are reserved for pixels beyond a threshold, as in ROS 1.
        between = np.clip(np.rint(100 * ratio), 1, 99)
    data = np.where(black <= meta.free_thresh, FREE, between)
    data = np.where(black >= meta.occupied_thresh, OCCUPIED, data)
    return np.where(pixels[:, :, -1] < 1.0, UNKNOWN, data) if alpha else data


def _read_image(path: Path) -> NDArray[np.unsignedinteger]:
    """Read the pixels of an image, (height, width, channels) uint8 or uint16."""
    try:
        if not path.is_file():
            raise MapError(f"{path}: the image that the map names is not there")
        with warnings.catch_warnings():
            # Of sizes, which are checked below, and of faults that do not keep it from reading.
            warnings.simplefilter("ignore")
            with Image.open(path, formats=FORMATS) as image:
                width, height = image.size
                if width * height > MAX_CELLS:
                    raise ValueError(f"{width} x {height} pixels, the limit is {MAX_CELLS}")
                return _channels(image)
    except MapError:
        raise
    except Exception as error:
        # Decoders raise whatever they like on broken files, from OSError to struct.error.
        raise MapError(f"{path}: not a usable image: {one_line(error)}") from error


def _channels(image: Image.Image) -> NDArray[np.unsignedinteger]:
    """Return an open image's pixels: one channel of grey or three of colour, and alpha if any."""
    if image.mode == "I" and image.format == "TIFF":
        raise ValueError("its pixels are 32-bit numbers: save it with 8 or 16 bits a pixel")
    if image.mode.startswith("I"):
        shades = np.asarray(image).astype(np.uint16)[:, :, None]
        # In a TIFF, 0 may stand for white; Pillow turns the shades of 8 bits only.
        white = getattr(image, "tag_v2", {}).get(PHOTOMETRIC, 1)
        return np.uint16(65535) - shades if white == 0 else shades
    if image.mode == "F":
        raise ValueError("its pixels are floating-point numbers")
    grey = image.mode in ("1", "L", "LA")
    clear = "A" in image.getbands() or "transparency" in image.info
    wanted = ("LA" if grey else "RGBA") if clear else ("L" if grey else "RGB")
    pixels = np.asarray(image.convert(wanted))
    return pixels.reshape(*pixels.shape[:2], -1)


def _number(path: Path, key: str, value: object) -> float:
    """Return a value as a finite number; like map_server, accept text, as YAML 1.1 reads 5e-2."""
    try:
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise ValueError
        number = float(value)
        if not math.isfinite(number):
            raise ValueError
    except (ValueError, OverflowError) as error:
        raise MapError(f"{path}: {key} holds {short(value)}, it must be a finite number") from error
    return number


def _flag(path: Path, key: str, value: object) -> bool:
    """Return a value as a truth value; like Nav2, accept a number or a word, also in quotes."""
    if isinstance(value, bool):
        return value
    if isinstance(value, str) and value.strip().lower() in WORDS:
        return WORDS[value.strip().lower()]
    if isinstance(value, int | float | str):
        try:
            number = float(value)
        except (ValueError, OverflowError):
            number = math.nan
        if number in (0, 1):
            return bool(number)
    raise MapError(f"{path}: {key} is {short(value)}, it must be 0 or 1")
