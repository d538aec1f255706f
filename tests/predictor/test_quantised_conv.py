"""Quantised convolutions: their rounding, and that runtimes compute with integers."""

import numpy as np
import pytest
import torch
from torch import nn

from foresee.mapping.context import CELLS
from predictor.compact import _Answers
from predictor.networks.compact_net import CompactConfig, CompactNet
from predictor.networks.quantised_conv import (
    INPUT_MAX,
    WEIGHT_MAX,
    QuantisedConv,
    convolutions,
    input_ranges,
)
from predictor.runtime import _converted, runner
from predictor.weights import WeightsError, load_weights, save_weights

CONVOLUTIONS = {
    "plain": lambda: nn.Conv2d(3, 8, 3, padding=1),
    "strided": lambda: nn.Conv2d(3, 8, 2, 2),
    "transposed": lambda: nn.ConvTranspose2d(3, 8, 2, 2),
}


@pytest.fixture
def net():
    """A small network that computes in 8-bit integers, not folded yet."""
    torch.manual_seed(0)
    config = CompactConfig(5, (8, 8, 16, 16), (0, 1, 1, 1), 4, kinds=("corridor", "narrow"))
    plain = CompactNet(config).eval()
    known, context = given()
    ranges = input_ranges(plain.convolutions(), lambda: plain(known, context))
    return plain.with_ranges(ranges)


def given(side=80):
    rng = torch.Generator().manual_seed(1)
    known = (torch.rand(1, 2, side, side, generator=rng) < 0.3).float()
    return known, torch.rand(1, 2, CELLS, CELLS, generator=rng)


@pytest.mark.parametrize("kind", CONVOLUTIONS)
@pytest.mark.parametrize("lowest", [0.0, -2.0])
def test_the_answer_is_near_that_of_the_floats(kind, lowest):
    torch.manual_seed(0)
    conv = CONVOLUTIONS[kind]()
    x = torch.rand(1, 3, 16, 16) * (3.0 - lowest) + lowest
    exact = conv(x).detach()
    rounded = QuantisedConv(conv, float(x.min()), float(x.max()))(x).detach()
    assert 0.0 < (rounded - exact).abs().max() < 0.02 * exact.abs().max()


@pytest.mark.parametrize("kind", CONVOLUTIONS)
def test_two_products_of_integers_fit_into_16_bits(kind):
    torch.manual_seed(0)
    layer = QuantisedConv(CONVOLUTIONS[kind](), 0.0, 1.0)
    shape = [1, 1, 1, 1]
    shape[layer.axis] = -1
    integers = layer.conv.weight / layer.weight_scales.reshape(shape)
    assert torch.allclose(integers, integers.round(), atol=1e-4)
    assert integers.abs().max().round() == WEIGHT_MAX
    assert 2 * INPUT_MAX * WEIGHT_MAX < 2**15


def test_inputs_outside_the_range_are_clipped():
    layer = QuantisedConv(nn.Conv2d(1, 1, 1), 0.0, 1.0)
    x = torch.tensor([-5.0, 0.0, 1.0, 5.0]).reshape(1, 1, 2, 2)
    a, b, c, d = layer(x).flatten().tolist()
    assert (a, d) == (b, c)


def test_the_context_is_not_quantised(net):
    known, context = given()
    places = len(net.convolutions())
    _, before = net.all_logits(known, context)
    _, after = net.folded().all_logits(known, context)
    assert torch.allclose(before, after, atol=1e-5)
    assert sum(isinstance(module, QuantisedConv) for module in net.modules()) == places
    assert not any(isinstance(module, QuantisedConv) for module in net.context.modules())
    # 12 convolutions in encoder and decoder, 3 down, 3 up, stem and head.
    assert places == 20
    assert len(convolutions(net.context)) == 11


def test_ranges_are_kept_in_the_file_and_left_out_of_a_training(net, tmp_path):
    save_weights(tmp_path / "it.safetensors", net, {})
    again, _ = load_weights(tmp_path / "it.safetensors", CompactNet)
    assert torch.equal(again.ranges, net.ranges)
    assert (again.ranges[:, 1] > again.ranges[:, 0]).all()
    bare = again.without_kinds_and_ranges()
    assert bare.ranges is None
    assert not bare.config.quantised
    assert bare.architecture == "foresee-compact-2"


def test_a_file_without_its_ranges_is_refused(net, tmp_path):
    net.ranges = None
    save_weights(tmp_path / "it.safetensors", net, {})
    with pytest.raises(WeightsError, match="tensor ranges is None"):
        load_weights(tmp_path / "it.safetensors", CompactNet)


def test_folding_twice_quantises_once(net):
    known, context = given()
    before = net.folded()(known, context)
    assert torch.equal(net.folded()(known, context), before)


def test_what_it_adds_to_a_convolution_moves_with_it():
    layer = QuantisedConv(nn.Conv2d(3, 8, 3), 0.0, 1.0).to("meta")
    tensors = {name: t.device.type for name, t in layer.state_dict().items()}
    assert tensors.keys() >= {"weight_scales", "zero_points"}
    assert set(tensors.values()) == {"meta"}


def test_other_convolutions_are_refused():
    for conv in (nn.Conv2d(4, 4, 3, groups=2), nn.Conv2d(4, 4, 3, padding="same")):
        with pytest.raises(ValueError, match="cannot be quantised"):
            QuantisedConv(conv, 0.0, 1.0)


def test_openvino_computes_in_integers_and_gives_the_answers_of_torch(net):
    ov = pytest.importorskip("openvino")
    shapes = (80, 80), (2, CELLS, CELLS)
    floats = _Answers(net.with_ranges(None).folded())
    answers = _Answers(net.folded())
    model = _converted(answers, shapes)
    model.reshape({0: [1, 80, 80], 1: [1, 2, CELLS, CELLS]})
    compiled = ov.Core().compile_model(model, "CPU", {"INFERENCE_PRECISION_HINT": "f32"})
    kinds = [
        node.get_rt_info()["layerType"].value
        for node in compiled.get_runtime_model().get_ops()
        if node.get_rt_info()["runtimePrecision"].value in ("u8", "i8")
    ]
    # All but the 11 of the context: 17 plain or strided ones, and 3 transposed ones.
    assert kinds.count("Convolution") == 17
    assert kinds.count("Deconvolution") == 3
    rng = np.random.default_rng(0)
    codes = rng.integers(0, 3, (1, 80, 80)).astype(np.int8)
    context = rng.integers(0, 50, (1, 2, CELLS, CELLS)).astype(np.int8)
    fast, plain, exact = (
        runner(module, name, *shapes)[0](codes, context)[:, :3]
        for module, name in ((answers, "openvino"), (answers, "torch"), (floats, "torch"))
    )
    assert np.abs(fast - plain).mean() < 2e-5
    assert np.abs(fast - exact).mean() > 1e-4
