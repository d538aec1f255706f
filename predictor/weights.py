"""Files of weights in the safetensors format, which contains no code."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from safetensors import SafetensorError, safe_open

from foresee.infra.atomic_file import write_whole
from foresee.infra.errors import LineError
from foresee.infra.input_file import check_input
from foresee.infra.plain_json import loads

if TYPE_CHECKING:
    import torch
    from torch import Tensor


SUFFIX = ".safetensors"
"""Ending of a file of weights."""
LARGEST_FILE, LARGEST_HEADER = 2**34, 2**24
"""Largest file that is read, and largest header of one [bytes]."""


class WeightsError(LineError):
    """A file holds no weights of this network; the message is one line."""


def weights_path(given: Path) -> Path:
    """Return the path of weights: a file's own, or that of weights that this package ships.

    Args:
        given: path of a .safetensors file, or name of a shipped one, such as `compact`.

    Raises:
        WeightsError: if it is neither.
    """
    if given.suffix == SUFFIX:
        return given
    shipped = {path.stem: path for path in Path(__file__).parent.glob(f"*{SUFFIX}")}
    if str(given) not in shipped:
        names = ", ".join(sorted(shipped))
        raise WeightsError(
            f"no shipped weights are named {str(given)!r}: choose one of {names}, "
            f"or give a file, FILE{SUFFIX}"
        )
    return shipped[str(given)]


def modified(weights: Path) -> int:
    """Return when a file was modified [ns], 0 if there is none; networks are cached by it."""
    return weights.stat().st_mtime_ns if weights.is_file() else 0


class Net(Protocol):
    """A network whose weights can be saved: a torch module made from a frozen configuration.

    Attributes:
        ARCHITECTURES: names of the architectures of this class in files of weights; the number at
            the end changes when the meaning of weights does.
        CONFIG: class of the configuration; its `of` makes one from the fields of a file's header,
            or raises ValueError, KeyError or TypeError.
        architecture: name of this network's architecture in files of weights.
        config: configuration of this network.
    """

    ARCHITECTURES: tuple[str, ...]
    CONFIG: Any
    config: Any

    @property
    def architecture(self) -> str: ...  # noqa: D102

    def state_dict(self) -> dict[str, Tensor]: ...  # noqa: D102


Kind = TypeVar("Kind", bound="torch.nn.Module")


def fingerprint(tensors: dict[str, Tensor]) -> str:
    """Return the SHA-256 of the names, shapes and values of all tensors."""
    digest = hashlib.sha256()
    for name in sorted(tensors):
        values = tensors[name].detach().cpu().contiguous()
        digest.update(f"{name} {tuple(values.shape)} {values.dtype}\n".encode())
        digest.update(values.numpy().tobytes())
    return digest.hexdigest()


def save_weights(path: Path, net: Net, facts: dict[str, Any]) -> None:
    """Write a network atomically.

    Args:
        path: path of the .safetensors file.
        net: the network.
        facts: facts of its training; plain data.
    """
    from safetensors.torch import save

    tensors = {name: values.contiguous() for name, values in net.state_dict().items()}
    header = {
        "architecture": net.architecture,
        "config": json.dumps(dataclasses.asdict(net.config)),
        "fingerprint": fingerprint(tensors),
        "facts": json.dumps(facts),
    }
    write_whole(path, save(tensors, metadata=header))


def read_facts(path: Path) -> tuple[str | None, dict[str, Any]]:
    """Read the architecture and the facts of a file, without its tensors.

    Raises:
        WeightsError: if the file is missing or damaged, or its header broken.
    """
    header, _ = _read(path)
    return header.get("architecture"), _facts(path, header)


def load_weights(path: Path, kind: type[Kind]) -> tuple[Kind, dict[str, Any]]:
    """Read a network and the facts of its training.

    Args:
        path: path of the file.
        kind: class of the network, a `Net`.

    Raises:
        WeightsError: if the file is missing, truncated or damaged, or holds another network or
            tensors of wrong shapes.
    """
    import torch

    known: Any = kind
    header, shapes = _read(path)
    if header.get("architecture") not in known.ARCHITECTURES:
        raise WeightsError(
            f"{path} holds weights of {header.get('architecture')!r}, not of "
            + " or ".join(map(repr, known.ARCHITECTURES))
        )
    facts = _facts(path, header)
    try:
        config = known.CONFIG.of(loads(header["config"]))
        # No memory is allocated before the shapes in the file are checked.
        with torch.device("meta"):
            net = known(config)
        if net.architecture != header["architecture"]:
            raise ValueError(f"it names {header['architecture']!r}, but shapes {net.architecture}")
    except (KeyError, ValueError, TypeError) as error:
        raise WeightsError(f"{path} has a broken header: {error}") from error
    needed = {name: tuple(v.shape) for name, v in net.state_dict().items()}
    for name in sorted(needed.keys() | shapes.keys()):
        if needed.get(name) != shapes.get(name):
            raise WeightsError(
                f"{path}: tensor {name} is {shapes.get(name)}, not {needed.get(name)}"
            )
    tensors = _tensors(path, shapes)
    wanted = {name: (tuple(v.shape), v.dtype) for name, v in net.state_dict().items()}
    stored = {name: (tuple(v.shape), v.dtype) for name, v in tensors.items()}
    for name in sorted(wanted.keys() | stored.keys()):
        if wanted.get(name) != stored.get(name):
            raise WeightsError(
                f"{path}: tensor {name} is {stored.get(name)}, not {wanted.get(name)}"
            )
    if fingerprint(tensors) != header["fingerprint"]:
        raise WeightsError(f"{path} is damaged: its values are not those that were written")
    if not all(torch.isfinite(values).all() for values in tensors.values()):
        raise WeightsError(f"{path} holds numbers that are not finite")
    net.load_state_dict(tensors, assign=True)
    return net.eval(), facts


def _read(path: Path) -> tuple[dict[str, str], dict[str, tuple[int, ...]]]:
    """Read the header of a file, and the shape of each of its tensors."""
    with _opened(path) as file:
        names = file.keys()
        shapes = {name: tuple(file.get_slice(name).get_shape()) for name in names}
        return file.metadata() or {}, shapes


def _tensors(path: Path, names: Iterable[str]) -> dict[str, Tensor]:
    with _opened(path) as file:
        return {name: file.get_tensor(name) for name in names}


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a safetensors file; raise WeightsError if it is none, or a damaged one."""
    try:
        check_input(path, LARGEST_FILE)
        with path.open("rb") as file:
            # The first eight bytes of a file are the length of its header.
            if int.from_bytes(file.read(8), "little") > LARGEST_HEADER:
                raise ValueError(f"its header has over {LARGEST_HEADER} bytes")
        with safe_open(path, framework="pt") as file:
            yield file
    except WeightsError:
        raise
    except FileNotFoundError:
        raise WeightsError(f"{path} does not exist") from None
    except (SafetensorError, OSError, ValueError) as error:
        raise WeightsError(f"{path} is no safetensors file, or a damaged one: {error}") from error


def _facts(path: Path, header: dict[str, str]) -> dict[str, Any]:
    try:
        return dict(loads(header["facts"])) | {"fingerprint": header["fingerprint"]}
    except (KeyError, ValueError, TypeError) as error:
        raise WeightsError(f"{path} has a broken header: {error}") from error
