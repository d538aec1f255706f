"""Checkpoints of trainings, each with the facts that identify its training."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

from foresee.infra.atomic_file import write_whole
from foresee.infra.errors import LineError
from predictor.weights import WeightsError, facts_of

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
        state: dict[str, Any] = torch.load(path, map_location=device, weights_only=True)
        theirs = state["facts"]
    except Exception as error:
        # On a damaged file torch.load raises exceptions of any kind.
        raise TrainError(f"{path} cannot be read: {error}; delete it to start again") from error
    other = [name for name in sorted(facts) if theirs.get(name) != facts[name]]
    if theirs != facts:
        # Both values are named if they are short.
        values = {name: f" ({theirs.get(name)}, not {facts[name]})" for name in other}
        named = ", ".join(n + (values[n] if len(values[n]) < 83 else "") for n in other)
        raise TrainError(
            f"{path.parent} holds a training with another {named}; give the command "
            "that began it, or choose another folder by --out"
        )
    return state


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
        _, theirs = facts_of(weights)
    except WeightsError as error:
        raise TrainError(f"{error}; delete it to make it again") from None
    if any(theirs.get(name) != value for name, value in facts.items()):
        raise TrainError(
            f"{weights} was trained in another way or on other frames: choose another"
            " folder by --out"
        )
    return True
