"""The far network: from a coarse map of all that was observed to what lies far beyond it.

It is a `CompactNet` on cells of 0.25 m, with one output: the probability that a cell is free as a
whole. Routes need no more, see `planner.risk.cost_map`.
"""

from __future__ import annotations

from predictor.networks.compact_net import CompactConfig, CompactNet

FAR = CompactConfig(patch=4, widths=(48, 96, 128, 160), blocks=(1, 2, 2, 2), outputs=1)
"""Shape of the network."""


class FarNet(CompactNet):
    """The network described at the head of this file.

    Its input are cells observed free as a whole, and cells observed occupied in part, (B, 2, H, W);
    its output are logits (B, 1, H, W).

    Args:
        config: shape of the network.
    """

    ARCHITECTURES = ("foresee-far-1",)

    def __init__(self, config: CompactConfig = FAR) -> None:
        if config.context or config.quantised:
            raise ValueError("a far network has no context, and is not quantised")
        super().__init__(config)
