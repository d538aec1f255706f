"""The layout in which Foxglove shows an MCAP file of a drive: maps and plan, and the confidence."""

from __future__ import annotations

import json
from typing import Any

from predictor.data.mcap_file import (
    CONFIDENCE,
    LASER,
    OBSERVED,
    PATH,
    PLAN,
    POSE,
    PREDICTED,
    SCAN,
)

ENDING = ".layout.json"
"""Ending of the file of a layout."""
CLEAR = "#00000000"
"""Colour of cells that are not drawn."""
MAPS, TRUST = "3D!maps", "3D!confidence"
"""Panels: the observed map above the predicted one, and above the confidence."""


def foxglove_layout() -> str:
    """Return the layout as JSON."""
    observed = {OBSERVED: _grid("#ffffff", "#202020")}
    content = {
        "configById": {
            MAPS: _panel(observed | {PREDICTED: _grid("#cfe2ff", "#d62728")}),
            TRUST: _panel(observed | {CONFIDENCE: _grid("#2c1e4a", "#ffd54a")}),
        },
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {"first": MAPS, "second": TRUST, "direction": "row", "splitPercentage": 60},
    }
    return json.dumps(content, indent=2) + "\n"


def _panel(grids: dict[str, Any]) -> dict[str, Any]:
    """Return a view from above that follows the robot, with some maps below path and scan."""
    lines = {
        PATH: {"visible": True, "type": "line", "lineWidth": 0.06, "gradient": ["#1f77b4"] * 2},
        PLAN: {"visible": True, "type": "line", "lineWidth": 0.1, "gradient": ["#2ca02c"] * 2},
        SCAN: {"visible": True, "colorMode": "flat", "flatColor": "#ff7f0e", "pointSize": 4},
        POSE: {"visible": True, "type": "arrow"},
    }
    camera = {
        "perspective": False,
        "distance": 20,
        "phi": 0,
        "thetaOffset": 0,
        "target": [0, 0, 0],
        "targetOffset": [0, 0, 0],
        "targetOrientation": [0, 0, 0, 1],
        "fovy": 45,
        "near": 0.5,
        "far": 5000,
    }
    return {
        "cameraState": camera,
        "followMode": "follow-position",
        "followTf": LASER,
        "scene": {"backgroundColor": "#8c8c8c"},
        "transforms": {},
        "topics": grids | lines,
        "layers": {},
    }


def _grid(low: str, high: str) -> dict[str, Any]:
    """Return the colours of a grid, from 0 to 100; unknown cells are not drawn."""
    return {
        "visible": True,
        "colorMode": "custom",
        "minColor": low,
        "maxColor": high,
        "unknownColor": CLEAR,
        "invalidColor": "#ff00ff",
    }
