"""The files of robots' logs: which there are, and the reader of each format."""

from __future__ import annotations

import hashlib
from pathlib import Path

from foresee.infra.errors import one_line
from predictor.data import CARMEN, LOG_FORMATS, PACKED
from predictor.data.bag_config import BagConfig
from predictor.data.bags import is_bag, read_bag
from predictor.data.carmen import log_name, read_carmen, sidecar_path
from predictor.data.frames import checksum
from predictor.data.laser_log import LaserLog, LogError


def site_name(path: Path) -> str:
    """Return the name of a log: the name of its file or folder without endings."""
    if path.is_file() and not is_bag(path):
        return log_name(path)
    return (path.with_suffix("") if path.suffix in PACKED else path).stem


def is_log(path: Path) -> bool:
    """Return whether a path is a bag, or has a name that ends as those of CARMEN logs do."""
    return is_bag(path) or path.name.removesuffix(".gz").endswith(CARMEN)


def is_folder(path: Path) -> bool:
    """Return whether a path is a folder that is not itself a log."""
    return path.is_dir() and not is_bag(path)


def logs_in(paths: list[Path]) -> list[Path]:
    """Return the logs that some paths name.

    A folder stands for the logs in it, see `is_log`.

    Args:
        paths: paths of logs and of folders of logs.

    Raises:
        LogError: if a folder holds no log.
    """
    expanded: list[Path] = []
    for path in paths:
        if not is_folder(path):
            expanded.append(path)
            continue
        logs = [entry for entry in sorted(path.iterdir()) if is_log(entry)]
        if not logs:
            raise LogError(f"{path} holds no log; logs are {LOG_FORMATS}")
        expanded += logs
    return expanded


def read_log(path: Path, bag: BagConfig | None = None) -> LaserLog:
    """Read a log of any format.

    Args:
        path: path of the log.
        bag: topics to read from a bag.

    Raises:
        LogError: if it cannot be read.
    """
    if is_folder(path):
        raise LogError(
            f"{path} is a folder without metadata.yaml, so it is no bag: give a file in it, or "
            "make that file with `ros2 bag reindex`"
        )
    return read_bag(path, bag) if is_bag(path) else read_carmen(path)


def log_sources(paths: list[Path]) -> dict[str, str]:
    """Return the name and the fingerprint of each log.

    Raises:
        LogError: if a log does not exist, or two have one name.
    """
    for path in paths:
        if not path.exists():
            raise LogError(f"{path}: no such file")
    try:
        logs = {site_name(path): _fingerprint(path) for path in paths}
    except (OSError, ValueError) as error:
        raise LogError(f"--log: {one_line(error)}: {', '.join(map(str, paths))}") from None
    if len(logs) < len(paths):
        raise LogError("--log: name each site once, and give each log a file name of its own")
    return logs


def _fingerprint(path: Path) -> str:
    """Return the SHA-256 of a log: of its file or folder, and of the file beside it."""
    files = sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path]
    beside = sidecar_path(path)
    digests = [checksum(file) for file in [*files, *([beside] if beside.is_file() else [])]]
    return hashlib.sha256("".join(digests).encode()).hexdigest()
