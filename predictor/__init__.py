"""What has been seen of a building, and what is believed of the rest.

A predictor is any object with `predict(known: Grid, pose) -> Prediction`; run `check_predictor`
on one of your own.
"""

import predictor.kernels  # noqa: F401  First: it says where the others keep their kernels.
from predictor.body import Body
from predictor.checking import check_predictor
from predictor.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame, OccupancyGrid
from predictor.none import NoPrediction
from predictor.prediction import (
    BadPredictionError,
    Prediction,
    Predictor,
    checked,
)
from predictor.registry import PredictorError, available, load_predictor
from predictor.scan import Scan

__all__ = [
    "FREE",
    "OCCUPIED",
    "UNKNOWN",
    "BadPredictionError",
    "Body",
    "Grid",
    "GridFrame",
    "NoPrediction",
    "OccupancyGrid",
    "Prediction",
    "Predictor",
    "PredictorError",
    "Scan",
    "available",
    "check_predictor",
    "checked",
    "load_predictor",
]
