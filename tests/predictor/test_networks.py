"""The networks of the paper: shapes, sizes, first weights."""

import subprocess
import sys

import pytest
import torch
from torch import nn

from predictor.networks import ARCHITECTURES
from predictor.networks.gan import Discriminator, judged
from predictor.networks.grey_net import GreyNet
from predictor.networks.image_config import ImageConfig
from predictor.networks.mlp import MLP
from predictor.networks.resnet_ff import BLOCKS, Block, ResNet
from predictor.networks.unet_ff import UNet
from predictor.training.image_learner import initialise


def parameters(net):
    return sum(values.numel() for values in net.parameters())


def outputs(net, kind, x):
    """Shapes of what all layers of a kind put out, in order."""
    shapes = []
    for module in net.modules():
        if isinstance(module, kind):
            module.register_forward_hook(lambda _, __, out: shapes.append(tuple(out.shape[1:])))
    with torch.inference_mode():
        net.eval()(*x)
    return shapes


@pytest.mark.parametrize(
    ("make", "count"),
    [
        (lambda: UNet(256, 1.0, "image"), 54_408_385),
        (lambda: ResNet(1.0, "image"), 11_370_881),
        (lambda: Discriminator(256, 1.0, "image"), 11_155_265),
        (lambda: MLP(256, 1.0), 67_962_880),
    ],
)
def test_they_are_as_large_as_their_files_say(make, count):
    with torch.device("meta"):
        assert parameters(make()) == count


@pytest.mark.parametrize("arch", ARCHITECTURES)
@pytest.mark.parametrize("side", [64, 128, 256])
def test_an_image_becomes_an_image(arch, side):
    net = GreyNet(ImageConfig(arch, width=1 / 16, side=side)).eval()
    with torch.inference_mode():
        image = net(torch.ones(2, 1, side, side))
    assert image.shape == (2, 1, side, side)
    assert float(image.abs().max()) <= 1.0


def test_the_u_net_halves_eight_times_and_back():
    shapes = outputs(UNet(256, 1 / 64, "image"), nn.Conv2d, [torch.zeros(1, 1, 256, 256)])
    assert [shape[1] for shape in shapes] == [128, 64, 32, 16, 8, 4, 2, 1]
    assert [shape[0] for shape in shapes] == [1, 2, 4, 8, 8, 8, 8, 8]


def test_decoder_layers_are_given_what_the_paper_prints():
    with torch.device("meta"):
        net = UNet(256, 1.0, "image")
    given = [m.in_channels for m in net.modules() if isinstance(m, nn.ConvTranspose2d)]
    assert given == [512, 1024, 1024, 1024, 1024, 512, 256, 128]
    encoder = [m.out_channels for m in net.modules() if isinstance(m, nn.Conv2d)]
    assert encoder == [64, 128, 256, 512, 512, 512, 512, 512]


def test_neither_the_first_nor_the_innermost_layer_is_normalised():
    net = UNet(256, 1 / 64, "batch")
    assert [isinstance(layer, nn.Sequential) for layer in net.down] == [False, *6 * [True], False]


def test_smaller_images_have_fewer_layers():
    assert [len(UNet(side, 1 / 64, "image").down) for side in (64, 128, 256)] == [6, 7, 8]


def test_the_resnet_has_nine_blocks_at_a_quarter_of_the_side():
    shapes = outputs(ResNet(1 / 16, "image"), Block, [torch.zeros(1, 1, 64, 64)])
    assert shapes == BLOCKS * [(16, 16, 16)]


@pytest.mark.parametrize("side", [64, 128, 256])
def test_the_discriminator_judges_patches(side):
    pair = 2 * [torch.zeros(1, 1, side, side)]
    net = Discriminator(side, 1 / 64, "image")
    shapes = outputs(net, nn.Conv2d, pair)
    assert len(shapes) == side.bit_length() - 2
    assert shapes[-1] == (1, 6, 6)


def test_the_discriminator_has_the_widths_of_the_paper():
    with torch.device("meta"):
        net = Discriminator(256, 1.0, "image")
    widths = [m.out_channels for m in net.modules() if isinstance(m, nn.Conv2d)]
    assert widths == [64, 128, 256, 512, 512, 512, 1]


def test_the_perceptron_has_five_layers():
    assert sum(isinstance(m, nn.Linear) for m in MLP(64, 0.1).modules()) == 5


def test_to_be_convinced_costs_least_when_right():
    sure = torch.full((1, 1, 6, 6), 9.0)
    assert float(judged(sure, True)) < 1e-3 < 8 < float(judged(sure, False))


@pytest.mark.parametrize("sigma", [0.02, 0.2])
def test_first_weights_are_normal(sigma):
    torch.manual_seed(0)
    net = UNet(64, 0.25, "batch")
    initialise(net, sigma)
    weights = torch.cat(
        [
            m.weight.detach().flatten()
            for m in net.modules()
            if isinstance(m, nn.Conv2d | nn.ConvTranspose2d)
        ]
    )
    assert float(weights.std()) == pytest.approx(sigma, rel=0.01)
    assert abs(float(weights.mean())) < 0.01 * sigma


@pytest.mark.parametrize("arch", ["unet_ff", "resnet_ff"])
def test_with_a_batch_of_one_an_image_alone_decides_its_answer(arch):
    torch.manual_seed(0)
    net = GreyNet(ImageConfig(arch, width=1 / 16, side=64)).eval()
    images = torch.randn(3, 1, 64, 64)
    with torch.inference_mode():
        together = net(images)
        alone = torch.cat([net(image[None]) for image in images])
    assert torch.allclose(together, alone, atol=1e-5)


def test_a_batch_of_one_is_normalised_alike_in_training_and_after_it():
    torch.manual_seed(0)
    net = GreyNet(ImageConfig("unet_ff", width=1 / 16, side=64))
    for module in net.modules():
        if isinstance(module, nn.Dropout):
            module.p = 0.0
    image = torch.randn(1, 1, 64, 64)
    assert torch.allclose(net.train()(image), net.eval()(image), atol=1e-5)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"arch": "vgg"}, "arch is 'vgg'.*unet_ff, resnet_ff, gan, mlp"),
        ({"side": 100}, "side is 100.*64, 128, 256"),
        ({"width": 0.0}, "width is 0.0"),
        ({"expansion": 2.5}, "expansion is 2.5"),
        ({"expansion": 1.25}, "expansion is 1.25.*even number"),
        ({"given": "all"}, "given is 'all'.*crop, window"),
    ],
)
def test_what_no_network_can_be_is_said(wrong, message):
    with pytest.raises(ValueError, match=message):
        ImageConfig(**wrong)


def modules_after(call):
    """Names of the modules that are imported when a new process has called the registry."""
    code = f"import sys; from predictor.registry import load_predictor; {call}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.split()


def test_a_predictor_without_a_network_needs_no_pytorch():
    assert "torch" not in modules_after("load_predictor('extend')")


def test_running_a_network_needs_no_training_code():
    modules = modules_after("load_predictor('compact')")
    assert "predictor.compact" in modules
    floors = ("training", "recording", "scoring", "evaluation")
    others = (*(f"predictor.{name}" for name in floors), "sim", "planner", "skimage", "matplotlib")
    assert not [name for name in modules if name.startswith(others)]
