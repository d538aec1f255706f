"""Weights on disk: safetensors, which hold numbers and a header and run no code."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from predictor.compact_net import CompactConfig, CompactNet
from predictor.whole import write_whole

ARCHITECTURE = "foresee-compact-1"
"""Written into every file; another number when the network changes its meaning."""


class WeightsError(ValueError):
    """A file does not hold weights of this network; the message is one line."""


def fingerprint(tensors: dict[str, Tensor]) -> str:
    """SHA-256 over names, shapes and values."""
    digest = hashlib.sha256()
    for name in sorted(tensors):
        values = tensors[name].detach().cpu().contiguous()
        digest.update(f"{name} {tuple(values.shape)} {values.dtype}\n".encode())
        digest.update(values.numpy().tobytes())
    return digest.hexdigest()


def save_weights(path: Path, net: CompactNet, facts: dict[str, Any]) -> None:
    """Write a network, whole or not at all.

    Args:
        path: of the .safetensors file.
        net: the network.
        facts: what is worth knowing of its training; plain data.
    """
    tensors = {name: values.contiguous() for name, values in net.state_dict().items()}
    header = {
        "architecture": ARCHITECTURE,
        "config": json.dumps(dataclasses.asdict(net.config)),
        "fingerprint": fingerprint(tensors),
        "facts": json.dumps(facts),
    }
    write_whole(path, save(tensors, metadata=header))


def load_weights(path: Path) -> tuple[CompactNet, dict[str, Any]]:
    """Read a network, and the facts that were written with it.

    Raises:
        WeightsError: if the file is missing, truncated, of another network, of wrong shapes, or
            not what was written.
    """
    try:
        with safe_open(path, framework="pt") as file:
            header = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except FileNotFoundError:
        raise WeightsError(f"{path} does not exist") from None
    except (SafetensorError, OSError) as error:
        raise WeightsError(f"{path} is no safetensors file, or a damaged one: {error}") from error
    if header.get("architecture") != ARCHITECTURE:
        raise WeightsError(
            f"{path} holds weights of {header.get('architecture')!r}, not of {ARCHITECTURE!r}"
        )
    try:
        config = _config(json.loads(header["config"]))
        facts = dict(json.loads(header["facts"])) | {"fingerprint": header["fingerprint"]}
    except (KeyError, ValueError, TypeError) as error:
        raise WeightsError(f"{path} has a broken header: {error}") from error
    # Without memory of its own, until it is known that the file fills it.
    with torch.device("meta"):
        net = CompactNet(config)
    wanted = {name: (tuple(v.shape), v.dtype) for name, v in net.state_dict().items()}
    found = {name: (tuple(v.shape), v.dtype) for name, v in tensors.items()}
    for name in sorted(wanted.keys() | found.keys()):
        if wanted.get(name) != found.get(name):
            raise WeightsError(
                f"{path}: tensor {name} is {found.get(name)}, not {wanted.get(name)}"
            )
    if fingerprint(tensors) != header["fingerprint"]:
        raise WeightsError(f"{path} is damaged: its values are not those that were written")
    if not all(torch.isfinite(values).all() for values in tensors.values()):
        raise WeightsError(f"{path} holds numbers that are not finite")
    net.load_state_dict(tensors, assign=True)
    return net.eval(), facts


def _config(fields: dict[str, Any]) -> CompactConfig:
    """The shape of a network that a header claims.

    Raises:
        ValueError: if no network can have it.
        KeyError: if something is missing.
        TypeError: if something is of the wrong kind.
    """
    config = CompactConfig(fields["patch"], tuple(fields["widths"]), tuple(fields["blocks"]))
    sizes, blocks = (config.patch, *config.widths), config.blocks
    sane = all(isinstance(n, int) and 0 < n <= 1024 for n in sizes)
    sane &= all(isinstance(n, int) and 0 <= n <= 64 for n in blocks)
    if not sane or len(config.widths) != len(config.blocks) or not 1 < len(config.widths) < 9:
        raise ValueError(f"no network is shaped like {config}")
    return config
