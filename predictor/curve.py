"""The curve of a training."""

from __future__ import annotations

import io
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from predictor.whole import write_whole


def draw_curve(log: list[dict[str, float]], path: Path) -> None:
    """The training curve: loss, and what validation says."""
    figure = Figure(figsize=(12, 3.4), layout="constrained")
    axes = figure.subplots(1, 3)
    steps = [entry["step"] for entry in log]
    panels = (
        ("loss", "nll"), ("iou_free", "iou_occupied", "auc_free"), ("ece_free", "brier_free"),
    )  # fmt: skip
    for axis, names in zip(axes, panels, strict=True):
        for name in names:
            label = name.replace("_", " ") + (" (training)" if name == "loss" else "")
            axis.plot(steps, [entry[name] for entry in log], label=label)
        axis.set_xlabel("step")
        axis.grid(alpha=0.3)
        axis.legend(frameon=False)
    FigureCanvasAgg(figure)
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=130)
    write_whole(path, buffer.getvalue())
