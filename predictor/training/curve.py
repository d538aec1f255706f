"""The curve of a training."""

from __future__ import annotations

import io
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from predictor.infra.atomic_file import write_whole


def draw_curve(
    log: list[dict[str, float]], path: Path, panels: tuple[tuple[str, ...], ...]
) -> None:
    """The training curve: losses, and what validation says.

    Args:
        log: entries, each with its "step".
        path: of the picture.
        panels: names of what is drawn, panel by panel.
    """
    figure = Figure(figsize=(4 * len(panels), 3.4), layout="constrained")
    axes = figure.subplots(1, len(panels), squeeze=False)[0]
    steps = [entry["step"] for entry in log]
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
