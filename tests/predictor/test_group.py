"""Several processes that train together take the step that one takes."""

import os
import socket

import pytest
import torch
import torch.distributed as dist
import torch.multiprocessing as mp
from torch import nn

from predictor.networks.grey_net import GreyNet
from predictor.networks.image_config import ImageConfig
from predictor.networks.normalisation import BatchNorm
from predictor.training.group import Group
from predictor.training.image_learner import Adversary, Learner
from predictor.training.settings import ImageTraining

ARCHS = ("unet_ff", "gan")
TRAINING = ImageTraining(batch=4, rate=1e-2)


def free_port():
    with socket.socket() as sock:
        sock.bind(("127.0.0.1", 0))
        return sock.getsockname()[1]


def two(work, *args):
    """Run a function in two processes, as torchrun would start them."""
    mp.spawn(_joined, (free_port(), work, args), nprocs=2)


def _joined(rank, port, work, args):
    os.environ |= {
        "RANK": str(rank),
        "LOCAL_RANK": str(rank),
        "WORLD_SIZE": "2",
        "MASTER_ADDR": "127.0.0.1",
        "MASTER_PORT": str(port),
    }
    torch.set_num_threads(1)
    group = Group.join()
    work(group, *args)
    group.leave()


def stepped(group, arch):
    """Weights and losses after a step without dropout, in double precision."""
    torch.manual_seed(0)
    net = GreyNet(ImageConfig(arch, width=1 / 16, side=64, over="batch")).double()
    for module in net.modules():
        if isinstance(module, nn.Dropout):
            module.p = 0.0
    learner = (Adversary if arch == "gan" else Learner)(net, TRAINING, group)
    net.train()
    share = TRAINING.batch // group.size
    mine = slice(group.rank * share, (group.rank + 1) * share)
    images = torch.randn(2, 4, 1, 64, 64, generator=torch.Generator().manual_seed(1))
    given, wanted = images.double().clamp(-1, 1)[:, mine]
    losses = group.mean(learner.learn(given, wanted, 1e-2))
    return learner.state()["parts"], losses


def save_steps(group, path):
    torch.save({arch: stepped(group, arch) for arch in ARCHS}, path / f"{group.rank}.pt")


@pytest.mark.slow(9)
def test_two_processes_take_the_step_of_one(tmp_path):
    two(save_steps, tmp_path)
    for arch in ARCHS:
        parts, losses = stepped(Group(0, 1, torch.device("cpu")), arch)
        for rank in (0, 1):
            theirs, of_theirs = torch.load(tmp_path / f"{rank}.pt", weights_only=True)[arch]
            assert torch.allclose(of_theirs, losses, atol=1e-9)
            for part, tensors in parts.items():
                for name, values in tensors.items():
                    assert torch.allclose(theirs[part][name], values, atol=1e-7), (part, name)


def normalise(group, path):
    norm = BatchNorm(3).double()
    x = torch.randn(4, 3, 5, 5, generator=torch.Generator().manual_seed(0)).double()
    mine = x[2 * group.rank : 2 * group.rank + 2].requires_grad_()
    out = norm(mine)
    (out * torch.arange(2 * 75).reshape(2, 3, 5, 5) * (group.rank + 1)).sum().backward()
    torch.save((out.detach(), mine.grad, norm.running_var), path / f"{group.rank}.pt")


@pytest.mark.slow
def test_normalisation_is_over_all_processes(tmp_path):
    two(normalise, tmp_path)
    theirs = [torch.load(tmp_path / f"{rank}.pt", weights_only=True) for rank in (0, 1)]
    norm = nn.BatchNorm2d(3).double()
    x = torch.randn(4, 3, 5, 5, generator=torch.Generator().manual_seed(0)).double()
    out = norm(x.requires_grad_())
    scale = torch.arange(2 * 75).reshape(2, 3, 5, 5)
    (out * torch.cat([scale, 2 * scale])).sum().backward()
    assert torch.allclose(torch.cat([each[0] for each in theirs]), out)
    assert torch.allclose(torch.cat([each[1] for each in theirs]), x.grad)
    assert all(torch.allclose(each[2], norm.running_var) for each in theirs)


def test_a_process_alone_needs_no_others():
    group = Group.join()
    assert (group.rank, group.size) == (0, 1)
    assert not dist.is_initialized()
    values = torch.ones(2)
    assert group.mean(values) is values
