"""Checkpoints of trainings, each with the facts that identify its training."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from foresee.infra.atomic_file import write_whole
from foresee.infra.errors import LineError, one_line
from foresee.infra.input_file import check_input
from predictor.weights import LARGEST_FILE, WeightsError, read_facts

if TYPE_CHECKING:
    import torch


class TrainError(LineError):
    """A training cannot start or be resumed; the message is one line."""


def write_checkpoint(path: Path, state: dict[str, Any]) -> None:
    """Write a checkpoint atomically.

    Args:
        path: path of the file.
        state: state of the training, plain data and tensors; its "facts" identify the training.
    """
    import torch

    buffer = io.BytesIO()
    torch.save(state, buffer)
    write_whole(path, buffer.getvalue())


def read_checkpoint(
    path: Path, facts: dict[str, Any], device: torch.device
) -> dict[str, Any] | None:
    """Read a checkpoint without running code from it; return None if there is none.

    Args:
        path: path of the file.
        facts: facts of the training to resume; plain data.
        device: device of the tensors returned.

    Raises:
        TrainError: if it cannot be read, or belongs to another training.
    """
    import torch

    if not path.exists():
        return None
    try:
        _refuse_compressed(path)
        state: dict[str, Any] = torch.load(path, map_location=device, weights_only=True)
        saved = dict(state["facts"])
        names = sorted(saved.keys() | facts.keys())
        changed = [name for name in names if saved.get(name) != facts.get(name)]
    except Exception as error:
        # On a damaged file torch.load raises exceptions of any kind.
        raise TrainError(
            f"{path} cannot be read: {one_line(error)}; delete it to start again"
        ) from error
    if changed:
        other = ", ".join(_difference(name, saved.get(name), facts.get(name)) for name in changed)
        raise TrainError(
            f"{path.parent} holds a training with another {other}; give the command "
            "that began it, or choose another folder by --out"
        )
    return state


def _refuse_compressed(path: Path) -> None:
    """Refuse a file that unpacks to more than its own size; torch compresses nothing.

    Raises:
        OSError: if it cannot be read.
        ValueError: if it is no regular file, or compressed.
        zipfile.BadZipFile: if it is no archive.
    """
    check_input(path, LARGEST_FILE)
    with zipfile.ZipFile(path) as file:
        if any(entry.compress_type != zipfile.ZIP_STORED for entry in file.infolist()):
            raise ValueError("it is compressed")
        if sum(entry.file_size for entry in file.infolist()) > path.stat().st_size:
            raise ValueError("it is smaller than it says")


def is_trained(weights: Path, facts: dict[str, Any]) -> bool:
    """Return whether a file of weights exists, from a training with these facts.

    Args:
        weights: file of the weights.
        facts: facts that the training must have; plain data. Other facts of it do not matter.

    Raises:
        TrainError: if the weights are damaged, or come from another training.
    """
    if not weights.exists():
        return False
    try:
        _, saved = read_facts(weights)
    except WeightsError as error:
        raise TrainError(f"{error}; delete it to make it again") from None
    if any(saved.get(name) != value for name, value in facts.items()):
        raise TrainError(
            f"{weights} was trained in another way or on other frames: choose another"
            " folder by --out"
        )
    return True


def _difference(name: str, saved: Any, wanted: Any) -> str:
    """Return the name of a fact that differs, with both values if they are short."""
    values = f"{saved}, not {wanted}"
    return f"{name} ({values})" if len(values) < 80 else name
