"""What the paper's networks descend on, and by how much: the values that the paper gives."""

from copy import deepcopy

import pytest
import torch
import torch.nn.functional as F
from torch import nn

from predictor.networks.gan import Discriminator, judged
from predictor.networks.grey_net import GreyNet
from predictor.networks.image_config import ImageConfig
from predictor.networks.resnet_ff import BLOCKS, Block
from predictor.training.image_learner import Adversary, Learner
from predictor.training.settings import ImageTraining


def small(arch):
    return GreyNet(ImageConfig(arch, width=1 / 16, side=64))


def images(seed):
    return torch.rand(2, 1, 64, 64, generator=torch.Generator().manual_seed(seed)) * 2 - 1


def gradients(part):
    return torch.cat([values.grad.flatten() for values in part.parameters()])


def test_the_first_three_decoder_layers_drop_half_of_their_outputs():
    dropouts = [
        [module.p for module in layer.modules() if isinstance(module, nn.Dropout)]
        for layer in small("unet_ff").net.up
    ]
    assert dropouts == [[0.5]] * 3 + [[]] * 3


def test_each_residual_block_drops_half_of_its_features():
    blocks = [module for module in small("resnet_ff").modules() if isinstance(module, Block)]
    rates = [[m.p for m in block.modules() if isinstance(m, nn.Dropout)] for block in blocks]
    assert rates == BLOCKS * [[0.5]]


@pytest.mark.parametrize("arch", ["unet_ff", "resnet_ff", "gan"])
def test_a_training_sets_the_rate_of_dropout(arch):
    net = small(arch)
    (Adversary if arch == "gan" else Learner)(net, ImageTraining(dropout=0.3))
    rates = {module.p for module in net.modules() if isinstance(module, nn.Dropout)}
    assert rates == {0.3}


def test_a_decoder_layer_in_training_answers_differently_each_time():
    net = small("unet_ff").train()
    with torch.no_grad():
        assert not torch.equal(net(images(0)), net(images(0)))


def test_the_encoders_rectifiers_leak_a_fifth():
    net = small("unet_ff").net.eval()
    outputs, inputs = [], []
    for layer in net.down:
        layer.register_forward_hook(lambda _, __, out: outputs.append(out))
        layer.register_forward_pre_hook(lambda _, given: inputs.append(given[0]))
    with torch.inference_mode():
        net(images(0))
    for out, given in zip(outputs[:-1], inputs[1:], strict=True):
        assert (out < 0).any()
        assert torch.allclose(given, torch.where(out > 0, out, 0.2 * out))


def test_the_discriminators_rectifiers_leak_a_fifth():
    modules = Discriminator(64, 1 / 16, "image").modules()
    slopes = [module.negative_slope for module in modules if isinstance(module, nn.LeakyReLU)]
    assert slopes == 4 * [0.2]


@pytest.mark.parametrize("learner", [Learner, Adversary])
def test_adam_has_the_momentum_of_the_paper(learner):
    made = learner(small("unet_ff"), ImageTraining())
    for adam in made.optimizers.values():
        assert [group["betas"] for group in adam.param_groups] == [(0.5, 0.999)]
        assert [group["lr"] for group in adam.param_groups] == [2e-4]


def test_without_a_discriminator_it_descends_on_the_mean_absolute_error():
    torch.manual_seed(0)
    net = small("unet_ff").eval()
    learner = Learner(net, ImageTraining())
    before = deepcopy(net)
    (loss,) = learner.learn(images(0), images(1), 1e-3)
    error = (before(images(0)) - images(1)).abs().mean()
    error.backward()
    assert float(loss) == pytest.approx(error.item())
    assert torch.allclose(gradients(net), gradients(before), atol=1e-7)


def test_the_generator_weighs_the_absolute_error_a_hundredfold():
    torch.manual_seed(0)
    net = small("gan").eval()
    learner = Adversary(net, ImageTraining())
    before = deepcopy(net)
    learner.learn(images(0), images(1), 1e-3)
    # The discriminator makes its step first.
    claimed = before(images(0))
    error = F.l1_loss(claimed, images(1))
    (judged(learner.judge(images(0), claimed), True) + 100 * error).backward()
    assert torch.allclose(gradients(net), gradients(before), atol=1e-6)


def test_the_discriminator_descends_on_half_of_its_error():
    torch.manual_seed(0)
    net = small("gan").eval()
    learner = Adversary(net, ImageTraining())
    before, claimed = deepcopy(learner.judge), net(images(0)).detach()
    learner.learn(images(0), images(1), 1e-3)
    of_claimed, of_wanted = (before(images(0), each) for each in (claimed, images(1)))
    (0.5 * (judged(of_claimed, False) + judged(of_wanted, True))).backward()
    assert torch.allclose(gradients(learner.judge), gradients(before), atol=1e-7)


def test_a_training_starts_from_the_first_weights_of_pix2pix():
    torch.manual_seed(0)
    net = GreyNet(ImageConfig("unet_ff", width=0.25, side=64))
    Learner(net, ImageTraining())
    weights = [
        m.weight.detach().flatten()
        for m in net.modules()
        if isinstance(m, nn.Conv2d | nn.ConvTranspose2d)
    ]
    assert float(torch.cat(weights).std()) == pytest.approx(0.02, rel=0.01)
