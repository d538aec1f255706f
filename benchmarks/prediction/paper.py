"""What Katyal et al. 2018 print: SSIM in simulation (Table I) and on physical data (Table II)."""

SSIM = {
    "simulated": {
        "1.10": {"unet_ff": 0.899, "resnet_ff": 0.861, "gan": 0.818},
        "1.30": {"unet_ff": 0.818, "resnet_ff": 0.780, "gan": 0.790},
        "1.50": {"unet_ff": 0.770, "resnet_ff": 0.773, "gan": 0.759},
        "1.70": {"unet_ff": 0.760, "resnet_ff": 0.752, "gan": 0.736},
        "2.00": {"unet_ff": 0.767, "resnet_ff": 0.770, "gan": 0.574},
    },
    "physical": {
        "1.10": {"unet_ff": 0.511, "resnet_ff": 0.523, "gan": 0.489},
        "1.30": {"unet_ff": 0.517, "resnet_ff": 0.534, "gan": 0.524},
        "1.50": {"unet_ff": 0.498, "resnet_ff": 0.489, "gan": 0.511},
        "1.70": {"unet_ff": 0.486, "resnet_ff": 0.504, "gan": 0.486},
        "2.00": {"unet_ff": 0.484, "resnet_ff": 0.499, "gan": 0.424},
    },
}
"""Place → expansion → network."""
