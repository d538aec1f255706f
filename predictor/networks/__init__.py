"""Networks: the compact one, and those of Katyal et al. 2018, each in a file of its own.

The paper's take a grey image (B, 1, side, side) of what was seen and give one of what is believed:
free +1, not known 0, occupied -1.
"""

ARCHITECTURES = ("unet_ff", "resnet_ff", "gan", "mlp")
"""Names of the paper's."""
