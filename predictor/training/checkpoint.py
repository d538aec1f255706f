"""Checkpoints: all that decides what a training does next, and what training it is."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

from predictor.infra.atomic_file import write_whole
from predictor.infra.errors import LineError
from predictor.weights import WeightsError, facts_of

if TYPE_CHECKING:
    import torch


class TrainError(LineError):
    """A training cannot be done or taken up; the message is one line."""


def write_checkpoint(path: Path, state: dict[str, Any]) -> None:
    """Write a checkpoint, whole or not at all.

    Args:
        path: of the file.
        state: plain data and tensors; its "facts" say what training it is.
    """
    import torch

    buffer = io.BytesIO()
    torch.save(state, buffer)
    write_whole(path, buffer.getvalue())


def read_checkpoint(
    path: Path, facts: dict[str, Any], device: torch.device
) -> dict[str, Any] | None:
    """Read a checkpoint, running nothing from it; None if there is none.

    Args:
        path: of the file.
        facts: of the training that wants to go on; plain data.
        device: where its tensors are wanted.

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
        # torch.load raises whatever the first wrong byte makes it.
        raise TrainError(f"{path} cannot be read: {error}; delete it to start again") from error
    if theirs != facts:
        other = ", ".join(
            _told(k, theirs.get(k), facts[k]) for k in sorted(facts) if theirs.get(k) != facts[k]
        )
        raise TrainError(
            f"{path.parent} holds a training with another {other}; give the command "
            "that began it, or choose another folder by --out"
        )
    return state


def is_trained(weights: Path, facts: dict[str, Any]) -> bool:
    """Whether weights are there that were trained as some facts say.

    Args:
        weights: file of them.
        facts: of the training that would make them; plain data, of the names that count.

    Raises:
        TrainError: if they are damaged, or were trained in another way.
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


def _told(name: str, theirs: Any, mine: Any) -> str:
    """What differs, and how where that fits into a line."""
    how = f"{theirs}, not {mine}"
    return f"{name} ({how})" if len(how) < 80 else name
