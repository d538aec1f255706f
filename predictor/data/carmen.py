"""Logs of the CARMEN toolkit, as in the Radish collection: text, or text compressed by gzip.

A scan is a line

    FLASER n r_1 … r_n x y theta odom_x odom_y odom_theta time host logger_time

with n ranges [m] and the pose of the laser [m, m, rad], which is the corrected pose if the log was
corrected. All other lines are ignored. The line contains neither the directions of the beams nor
the range that stands for "no return". A .json file of the log's name beside it may give them:

    {"angle_min_deg": -90.0, "angle_inc_deg": 0.5, "no_return_at_or_above_m": 80.0,
     "timestamps_usable": true}

Without it, the LIDAR is assumed to be a SICK with a field of view of 180°.
"""

from __future__ import annotations

import codecs
import gzip
import math
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from foresee.infra.errors import one_line
from foresee.infra.input_file import check_input
from foresee.infra.plain_json import read_json
from foresee.mapping.scan import Scan
from predictor.data import CARMEN
from predictor.data.laser_log import LaserLog, LogError, cleaned

NO_RETURN = 80.0
"""Range at or above which a beam of a SICK had no return [m]."""
HALF_DEGREE = 300
"""Number of beams at or above which they are half a degree apart instead of one degree."""
COMMON = (180, 181, 360, 361)
"""Usual numbers of beams of a SICK's scan."""
BINARY = frozenset(map(chr, range(32))) - frozenset("\t\n\v\f\r\x1a")
"""Characters that no text holds; control-Z ends the files of old systems."""
LARGEST_LOG, MOST_TEXT, MOST_LINE = 2**32, 2**30, 2**20
"""Largest log that is read [bytes], longest text that it unpacks to, and longest line."""
ANGLES = ("angle_min_deg", "angle_inc_deg")
"""Keys of the first beam's direction, and of the angle from one beam to the next."""


@dataclass(frozen=True)
class Sidecar:
    """Facts that the lines of a log do not contain.

    Attributes:
        beams: direction of the first beam, and angle from one to the next [rad]; None: unknown.
        no_return: range at or above which a beam had no return [m].
        clock: whether the times of the scans can be used.
    """

    beams: tuple[float, float] | None = None
    no_return: float = NO_RETURN
    clock: bool = True

    @classmethod
    def beside(cls, path: Path) -> Sidecar:
        """Read the file beside a log, if there is one.

        Raises:
            LogError: if it cannot be read, or holds no numbers where there must be some.
        """
        beside = sidecar_path(path)
        if not beside.is_file():
            return cls()
        try:
            said = read_json(beside, MOST_LINE).items()
            facts = {key: value for key, value in said if value is not None}
            angles = {key: float(facts[key]) for key in ANGLES if key in facts}
            no_return = float(facts.get("no_return_at_or_above_m", NO_RETURN))
        except (OSError, ValueError, TypeError, AttributeError, OverflowError) as error:
            raise LogError(f"{beside} cannot be read: {error}") from error
        sense = angles.get(ANGLES[1]) != 0 and all(map(math.isfinite, angles.values()))
        if not (no_return > 0 and sense):
            raise LogError(f"{beside}: its angles or ranges make no sense")
        if len(angles) == 1:
            raise LogError(f"{beside} gives only one of {' and '.join(ANGLES)}: give both")
        first, step = (math.radians(angles.get(key, 0.0)) for key in ANGLES)
        clock = bool(facts.get("timestamps_usable", True))
        return cls((first, step) if angles else None, no_return, clock)


def log_name(path: Path) -> str:
    """Return the name of a log without endings."""
    name = path.name.removesuffix(".gz")
    for ending in (*CARMEN, ".txt"):
        name = name.removesuffix(ending)
    return name


def sidecar_path(path: Path) -> Path:
    """Return the path of the .json file beside a log, which may be missing."""
    return path.with_name(log_name(path) + ".json")


def read_carmen(path: Path) -> LaserLog:
    """Read a whole log.

    Ranges that are negative or NaN, and scans of less than two beams, are left out and counted. Any
    other fault is an error, since the lines after it cannot be trusted.

    Raises:
        LogError: if the log is cut off or damaged, or has no FLASER line.
    """
    sidecar = Sidecar.beside(path)
    scans: list[Scan] = []
    poses: list[NDArray[np.float64]] = []
    times: list[float] = []
    kinds: Counter[str] = Counter()
    bad = empty = most = 0
    for number, line in _lines(path):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        kinds[words[0]] += 1
        if words[0] != "FLASER":
            continue
        values = _numbers(path, number, words)
        count = len(values) - 7
        # A host and another time may follow. If they are cut off, the number before may be, too.
        after = len(words) - count
        if after < most:
            raise LogError(
                f"{path}, line {number} is cut off: {after - 9} words after its time, "
                f"lines before it have {most - 9}"
            )
        most = after
        if count < 2:
            empty += 1
            continue
        ranges, wrong = cleaned(values[:count], 0.0)
        bad += wrong
        # A SICK returns this where nothing is in range, but also for black walls and for glass.
        ranges = np.where(ranges >= sidecar.no_return, np.nan, ranges)
        beams = sidecar.beams or _beams(path, number, count)
        scans.append(Scan(ranges, *beams, sidecar.no_return))
        poses.append(values[count : count + 3])
        times.append(float(values[-1]))
    if not scans:
        if empty:
            raise LogError(f"{path}: each of its {empty} scans has less than two beams")
        names = ", ".join(kind[:20] for kind, _ in kinds.most_common(8)) or "none"
        raise LogError(f"{path} has no FLASER line; its lines are: {names}")
    usable = sidecar.clock and bool((np.diff(times) > 0).all())
    clock = np.array(times) if usable else None
    skipped = {"bad ranges": bad, "bad scans": empty}
    return LaserLog(log_name(path), tuple(scans), np.array(poses), clock, skipped)


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the lines of a log with their numbers from 1."""
    number = length = 0
    try:
        check_input(path, LARGEST_LOG)
        with path.open("rb") as raw:
            packed = raw.read(2) == b"\x1f\x8b"
        unpacked = gzip.open if packed else open
        with unpacked(path, "rb") as file:
            wide = file.read(2) in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
        # Comments may be in any encoding; what is read is ASCII.
        encoding = "utf-16" if wide else "utf-8-sig"
        with unpacked(path, "rt", encoding=encoding, errors="surrogateescape") as file:
            for number, line in enumerate(iter(lambda: file.readline(MOST_LINE), ""), 1):
                length += len(line)
                if len(line) == MOST_LINE or length > MOST_TEXT:
                    raise LogError(
                        f"{path} is no CARMEN log: line {number} or the text is too long"
                    )
                if not BINARY.isdisjoint(line):
                    raise LogError(f"{path} is no CARMEN log: it is not text (line {number})")
                yield number, line
    except LogError:
        raise
    except EOFError:
        raise LogError(f"{path} is cut off after line {number}") from None
    except UnicodeError:
        raise LogError(f"{path} is no CARMEN log: it is not text (line {number + 1})") from None
    except (gzip.BadGzipFile, zlib.error) as error:
        raise LogError(f"{path} is damaged after line {number}: {error}") from error
    except (OSError, ValueError) as error:
        raise LogError(f"{path} cannot be read: {one_line(error)}") from error


def _numbers(path: Path, number: int, words: list[str]) -> NDArray[np.float64]:
    """Return ranges (n,), laser pose (3,), odometry pose (3,) and time of a FLASER line."""
    where = f"{path}, line {number}"
    try:
        count = int(words[1])
    except (IndexError, ValueError):
        raise LogError(f"{where}: FLASER is followed by no number of beams") from None
    if count < 0:
        raise LogError(f"{where}: a scan of {count} beams")
    if len(words) > count + 11:
        raise LogError(
            f"{where} has {len(words) - count - 11} words too many after {count} ranges:"
            " is that the number of its beams?"
        )
    if len(words) < count + 9:
        raise LogError(
            f"{where} is cut off: {count} ranges, two poses and a time are "
            f"{count + 7} numbers, it has {len(words) - 2}"
        )
    try:
        values = np.array(words[2 : count + 9], dtype=np.float64)
    except ValueError as error:
        raise LogError(f"{where}: {error}") from None
    if not np.isfinite(values[count:]).all():
        raise LogError(f"{where}: its pose or time is not finite")
    return values


def _beams(path: Path, number: int, count: int) -> tuple[float, float]:
    """Return a SICK's first direction, and the angle from one beam to the next [rad]."""
    if count not in COMMON:
        raise LogError(
            f"{path}, line {number}: the directions of {count} beams are not known: give "
            f"{' and '.join(ANGLES)} in {log_name(path)}.json beside it"
        )
    return math.radians(-90.0), math.radians(1.0 if count < HALF_DEGREE else 0.5)
