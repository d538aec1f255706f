"""Networks, one file for each: compact, frontiers, and those of Katyal et al. 2018.

The paper's networks take a grey image (B, 1, side, side) of the observed map, and return one of the
predicted map: free +1, unknown 0, occupied -1. `grey_net.GreyNet` makes each of them by name.
"""

PROPOSED = ("unet_ff", "resnet_ff", "gan")
"""Architectures that the paper proposes."""
PAPER = (*PROPOSED, "mlp")
"""All architectures of the paper: those that it proposes, and its baseline, a perceptron."""
ARCHITECTURES = PAPER
"""Architectures of grey-image networks that can be trained; another one is appended here."""
