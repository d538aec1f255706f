"""The contract of a predictor, over every one that is registered, and what `checked` refuses."""

import dataclasses

import numpy as np
import pytest

from predictor import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    BadPredictionError,
    Grid,
    GridFrame,
    Prediction,
    Predictor,
    available,
    check_predictor,
    checked,
    load_predictor,
)

FRAME = GridFrame(0.05, (1.0, -2.0), (80, 80))
POSE = np.array([3.0, 0.0, 0.4])


def cluttered(seed: int = 0) -> Grid:
    rng = np.random.default_rng(seed)
    cells = rng.choice(np.array([FREE, OCCUPIED, UNKNOWN], np.int8), FRAME.shape)
    return Grid(FRAME, cells)


def some_prediction(**changes) -> Prediction:
    half = np.full(FRAME.shape, 0.5, np.float32)
    return dataclasses.replace(Prediction(FRAME, half, half, half), **changes)


@pytest.mark.parametrize("name", available())
def test_every_registered_predictor_keeps_the_contract(name):
    predictor = load_predictor(name)
    assert isinstance(predictor, Predictor)
    check_predictor(predictor)


@pytest.mark.parametrize("name", available())
def test_every_registered_predictor_keeps_what_was_observed(name):
    known = cluttered()
    prediction = load_predictor(name).predict(known, POSE)
    seen = ~known.unknown
    assert np.array_equal(prediction.p_free[seen], known.free[seen])
    assert np.array_equal(prediction.p_occupied[seen], known.occupied[seen])
    assert (prediction.confidence[seen] == 1).all()


@pytest.mark.parametrize("name", available())
def test_no_registered_predictor_is_sure_of_a_map_in_which_nothing_was_seen(name):
    known = Grid(FRAME, np.full(FRAME.shape, UNKNOWN, np.int8))
    assert (load_predictor(name).predict(known, POSE).confidence < 0.5).all()


def test_no_prediction_has_no_confidence_in_unknown_cells():
    known = cluttered()
    prediction = load_predictor("none").predict(known, POSE)
    for values in (prediction.p_free, prediction.p_occupied, prediction.confidence):
        assert not values[known.unknown].any()


def test_checked_puts_observed_cells_back():
    known = cluttered()
    prediction = checked(some_prediction(), known)
    assert np.array_equal(prediction.p_free == 1, known.free)
    assert np.array_equal(prediction.p_occupied == 1, known.occupied)
    assert (prediction.confidence[known.unknown] == 0.5).all()


@pytest.mark.parametrize("field", ["p_free", "p_occupied", "confidence"])
def test_nan_makes_its_cell_unknown(field):
    known = Grid(FRAME, np.full(FRAME.shape, UNKNOWN, np.int8))
    values = np.full(FRAME.shape, 0.5, np.float32)
    values[3, 4] = np.nan
    prediction = checked(some_prediction(**{field: values}), known)
    for values in (prediction.p_free, prediction.p_occupied, prediction.confidence):
        assert values[3, 4] == 0
        assert values[4, 3] == 0.5


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"p_free": np.full((80, 79), 0.5)}, "p_free"),
        ({"confidence": np.full((80, 80), 1.5)}, r"outside \[0, 1\]"),
        ({"p_occupied": np.full((80, 80), -0.1)}, r"outside \[0, 1\]"),
        ({"p_free": np.full((80, 80), np.inf)}, r"outside \[0, 1\]"),
        ({"p_free": np.full((80, 80), 0.6)}, "exceeds 1"),
        ({"p_free": np.full((80, 80), 0.5j)}, "real numbers"),
        ({"p_free": np.full((80, 80), "a")}, "real numbers"),
        ({"p_free": None}, "p_free"),
        ({"frame": GridFrame(0.05, (1.0, -1.0), (80, 80))}, "lies on"),
        ({"hypotheses": np.zeros((80, 80))}, "hypotheses"),
        ({"hypotheses": np.full((2, 80, 80), 3.0)}, "hypotheses"),
    ],
)
def test_checked_refuses(changes, message):
    with pytest.raises(BadPredictionError, match=message):
        checked(some_prediction(**changes), cluttered())


@pytest.mark.parametrize("answer", [None, 3, (np.zeros(3), np.zeros(3))])
def test_checked_refuses_what_is_no_prediction(answer):
    with pytest.raises(BadPredictionError, match="must return a Prediction"):
        checked(answer, cluttered())


class Overwrites:
    def predict(self, known, pose):
        known.cells[:] = FREE
        return load_predictor("none").predict(known, pose)


class Dithers:
    def __init__(self):
        self.calls = 0

    def predict(self, known, pose):
        self.calls += 1
        p_free = np.full(known.frame.shape, 0.1 * (self.calls % 2), np.float32)
        return Prediction(known.frame, p_free, 0 * p_free, p_free)


@pytest.mark.parametrize(
    ("predictor", "message"),
    [
        (Overwrites(), "changed the map"),
        (Dithers(), "two answers"),
        (object(), "no method predict"),
    ],
)
def test_check_predictor_says_what_is_wrong(predictor, message):
    with pytest.raises(BadPredictionError, match=message):
        check_predictor(predictor)
