"""Normalisation of channels: over each image, or over a batch.

With a batch of one, as in the paper, batch normalisation uses the statistics of the image itself,
and pix2pix does so at prediction too. With larger batches the statistics are those of the batch,
over all processes of a training, and at prediction their running average.
"""

from __future__ import annotations

import torch
import torch.distributed as dist
from torch import Tensor, nn
from torch.distributed.nn.functional import all_reduce


def norm_of(over: str, channels: int) -> nn.Module:
    """Return the normalisation of a layer.

    Args:
        over: "image" or "batch".
        channels: number of channels of the layer.
    """
    return nn.InstanceNorm2d(channels, affine=True) if over == "image" else BatchNorm(channels)


class BatchNorm(nn.BatchNorm2d):
    """Batch normalisation over the samples of all processes.

    torch.nn.SyncBatchNorm does the same, but only on GPUs.
    """

    def forward(self, x: Tensor) -> Tensor:
        """Normalise (B, C, H, W); each process must hold the same number of samples."""
        self._check_input_dim(x)
        alone = not dist.is_initialized() or dist.get_world_size() == 1
        if alone or not self.training:
            return super().forward(x)
        processes = dist.get_world_size()
        values = x.to(self.weight.dtype)
        mean = all_reduce(values.mean(dim=(0, 2, 3))) / processes
        values = values - mean[:, None, None]
        variance = all_reduce(values.square().mean(dim=(0, 2, 3))) / processes
        with torch.no_grad():
            count = processes * x.numel() / x.shape[1]
            assert self.running_mean is not None
            assert self.running_var is not None
            assert self.num_batches_tracked is not None
            assert self.momentum is not None
            self.running_mean.lerp_(mean, self.momentum)
            self.running_var.lerp_(variance * count / (count - 1), self.momentum)
            self.num_batches_tracked += 1
        scale = self.weight * torch.rsqrt(variance + self.eps)
        return (values * scale[:, None, None] + self.bias[:, None, None]).to(x.dtype)
