"""Limit the instruction set that OpenVINO uses, so that predictions do not depend on the processor.

OpenVINO is imported only where it is needed, since drives without a network import this module.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.util import find_spec

import numpy as np

NEWEST = "AVX512_CORE_VNNI"
"""Newest instruction set that OpenVINO may use, as oneDNN names it. With AMX, which is newer, sums
of quantised networks are rounded in another way: drives would differ between processors."""
VARIABLE = "ONEDNN_MAX_CPU_ISA"
"""Variable of the environment that limits the instructions."""


@contextmanager
def older_instructions() -> Iterator[None]:
    """Hold OpenVINO to `NEWEST`, unless the user has chosen an instruction set.

    OpenVINO reads the variable when it first compiles a network, and has no other setting. It is
    removed again, since PyTorch reads it as well, and trains faster without it.
    """
    if VARIABLE in os.environ:
        yield
        return
    os.environ[VARIABLE] = NEWEST
    try:
        yield
    finally:
        del os.environ[VARIABLE]


@cache
def settle_instructions() -> None:
    """Let OpenVINO read `VARIABLE` now, before another package compiles a network."""
    if not find_spec("openvino"):
        return
    import openvino as ov
    from openvino import opset15 as ops

    given = ops.parameter([1, 1], np.float32)
    smallest = ov.Model([ops.abs(given)], [given])
    with older_instructions():
        ov.Core().compile_model(smallest, "CPU", {"INFERENCE_NUM_THREADS": 1})
