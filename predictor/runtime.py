"""Runtimes of networks: OpenVINO if it is installed, else PyTorch, on a GPU if there is one."""

from __future__ import annotations

import signal
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import version
from importlib.util import find_spec
from threading import Lock
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from predictor.instructions import older_instructions

Runner = Callable[..., NDArray[np.float32]]
RUNTIMES = ("openvino", "torch")
"""Names of the runtimes, the fastest first."""
MOST_SIZES = 8
"""Number of input sizes for which compiled networks are kept."""


def fastest_device() -> torch.device:
    """Return a GPU if there is one, else the CPU."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def runner(module: nn.Module, runtime: str | None, *shapes: tuple[int, ...]) -> tuple[Runner, str]:
    """Return a function that runs a network, and the name and version of the runtime.

    OpenVINO uses one core; PyTorch a GPU if there is one, else as many cores as
    `torch.set_num_threads` allows.

    Args:
        module: network from int8 arrays (1, ...) to one float array.
        runtime: one of `RUNTIMES`; None: the first that is installed.
        shapes: a valid shape of each input array, without the first axis.

    Raises:
        ValueError: if the runtime is unknown or not installed.
    """
    if runtime is None:
        runtime = "openvino" if find_spec("openvino") else "torch"
    if runtime not in RUNTIMES:
        raise ValueError(f"runtime is {runtime!r}, it must be one of {', '.join(RUNTIMES)}")
    if not find_spec(runtime):
        raise ValueError(f"{runtime} is not installed: pip install 'foresee-nav[openvino]'")
    name = f"{runtime} {version(runtime)}"
    if runtime == "openvino":
        return _openvino(module, shapes), name
    device = fastest_device()
    return _torch(module, device), name if device.type == "cpu" else f"{name} on {device.type}"


def _torch(module: nn.Module, device: torch.device) -> Runner:
    module.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]

    def run(*arrays: NDArray[np.int8]) -> NDArray[np.float32]:
        with torch.inference_mode():
            given = (torch.from_numpy(array).to(device) for array in arrays)
            return np.asarray(module(*given).cpu().numpy())

    return run


def _openvino(module: nn.Module, shapes: tuple[tuple[int, ...], ...]) -> Runner:
    import openvino as ov

    with _held_back_interrupt():
        model = _converted(module, shapes)
    core = ov.Core()
    requests: dict[tuple[tuple[int, ...], ...], Any] = {}
    lock = Lock()

    def run(*arrays: NDArray[np.int8]) -> NDArray[np.float32]:
        # A request serves one caller at a time.
        with lock:
            return answer(*arrays)

    def answer(*arrays: NDArray[np.int8]) -> NDArray[np.float32]:
        # Compiled for this size of window: 10 % faster than for any size.
        sizes = tuple(array.shape for array in arrays)
        if sizes not in requests:
            if len(requests) == MOST_SIZES:
                requests.clear()
            sized = model.clone()
            sized.reshape({number: list(size) for number, size in enumerate(sizes)})
            settings = {"INFERENCE_NUM_THREADS": 1, "INFERENCE_PRECISION_HINT": "f32"}
            with older_instructions():
                requests[sizes] = core.compile_model(sized, "CPU", settings).create_infer_request()
        return np.asarray(requests[sizes].infer(dict(enumerate(arrays)))[0])

    return run


def _converted(module: nn.Module, shapes: tuple[tuple[int, ...], ...]) -> Any:
    """Return a network as a model of OpenVINO."""
    # The frontend itself, because `convert_model` takes seconds and sends telemetry.
    from openvino.frontend import FrontEndManager
    from openvino.frontend.pytorch.ts_decoder import TorchScriptPythonDecoder
    from openvino.passes import ConstantFolding, Manager

    examples = tuple(torch.zeros(1, *shape, dtype=torch.int8) for shape in shapes)
    with warnings.catch_warnings():
        # Deprecated, but the only form that OpenVINO reads for maps of any size.
        warnings.simplefilter("ignore", DeprecationWarning)
        # Checks of shapes are traced with the result that they had for the example.
        warnings.simplefilter("ignore", torch.jit.TracerWarning)  # type: ignore[attr-defined]
        traced = torch.jit.trace(module.eval(), examples, check_trace=False)
    frontend = FrontEndManager().load_by_framework("pytorch")
    decoder = TorchScriptPythonDecoder(traced, example_input=examples)
    model = frontend.convert(frontend.load(decoder))
    # OpenVINO uses integers only where the ranges of quantised convolutions are constants.
    passes = Manager()
    passes.register_pass(ConstantFolding())
    passes.run_passes(model)
    return model


@contextmanager
def _held_back_interrupt() -> Iterator[None]:
    """Delay Ctrl-C to the end of this context: OpenVINO would turn it into an error of its own."""
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or before is None:
        yield
        return
    interrupts: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: interrupts.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if interrupts:
            signal.raise_signal(signal.SIGINT)
