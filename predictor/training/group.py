"""The processes that train one network together: this process alone, or those of `torchrun`."""

from __future__ import annotations

import os
from dataclasses import dataclass

import torch
import torch.distributed as dist
from torch import Tensor, nn
from torch.nn.parallel import DistributedDataParallel


@dataclass(frozen=True)
class Group:
    """A process and the processes that it trains with.

    Attributes:
        rank: number of this process.
        size: number of processes.
        device: device that this process computes on.
    """

    rank: int
    size: int
    device: torch.device

    @classmethod
    def alone(cls) -> Group:
        """Return a group of this process alone, on a GPU if there is one."""
        return cls(0, 1, torch.device("cuda" if torch.cuda.is_available() else "cpu"))

    @classmethod
    def join(cls) -> Group:
        """Return this process alone, or wait for all that torchrun has started, and join them."""
        if "WORLD_SIZE" not in os.environ:
            return cls.alone()
        device, backend = torch.device("cpu"), "gloo"
        if torch.cuda.is_available():
            device, backend = torch.device("cuda", int(os.environ["LOCAL_RANK"])), "nccl"
            torch.cuda.set_device(device)
        dist.init_process_group(backend)
        return cls(dist.get_rank(), dist.get_world_size(), device)

    def leave(self) -> None:
        """Leave the group."""
        if dist.is_initialized():
            dist.destroy_process_group()

    @property
    def first(self) -> bool:
        """Whether this process writes the files and shows the progress."""
        return self.rank == 0

    def shared(self, net: nn.Module) -> nn.Module:
        """Wrap a network so that all processes share its initial weights and its gradients."""
        if self.size == 1:
            return net
        places = [self.device] if self.device.type == "cuda" else None
        # Running averages need no broadcast: `BatchNorm` already spans all processes.
        return DistributedDataParallel(net, device_ids=places, broadcast_buffers=False)

    def mean(self, values: Tensor) -> Tensor:
        """Return the mean of the values over the processes."""
        if self.size > 1:
            dist.all_reduce(values)
            values = values / self.size
        return values
