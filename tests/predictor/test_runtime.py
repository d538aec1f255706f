"""Runtimes: the shipped networks create nothing on another device than that of their input."""

import pytest
import torch

from predictor import compact, image_predictor
from predictor.image_predictor import ImagePredictor
from predictor.networks import ARCHITECTURES
from predictor.networks.compact_net import CompactNet
from predictor.networks.grey_net import GreyNet
from predictor.networks.image_config import ImageConfig
from predictor.weights import load_weights, save_weights


@pytest.fixture
def devices(monkeypatch):
    """Devices of the answers of all networks that are made; they run on torch's device meta."""
    found = []

    def runner(module, runtime, *shapes):
        given = [torch.zeros(1, *shape, dtype=torch.int8, device="meta") for shape in shapes]
        with torch.inference_mode():
            # Like a GPU, it refuses tensors of the CPU.
            found.append(module.to("meta")(*given).device.type)
        return lambda *arrays: None, "meta"

    for module in (compact, image_predictor):
        monkeypatch.setattr(module, "runner", runner)
    return found


def test_compact_runs_on_any_device(devices, tmp_path):
    # On the device meta, PyTorch cannot simulate integers; all else is the same.
    net, facts = load_weights(compact.SHIPPED, CompactNet)
    save_weights(tmp_path / "floats.safetensors", net.with_ranges(None), facts)
    compact._loaded.__wrapped__(tmp_path / "floats.safetensors", 0, None)
    assert devices == ["meta"]


@pytest.mark.parametrize("arch", ARCHITECTURES)
def test_a_network_of_the_paper_runs_on_any_device(devices, tmp_path, arch):
    path = tmp_path / "net.safetensors"
    save_weights(path, GreyNet(ImageConfig(arch, width=1 / 64, side=64)), {})
    ImagePredictor(path)
    assert devices == ["meta"]
