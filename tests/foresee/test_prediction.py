"""The contract of a predictor, over every one that is registered, and what `checked` refuses."""

import dataclasses
import re
import time
from pathlib import Path

import numpy as np
import pytest

from foresee.checking import check_predictor
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from foresee.prediction import BadPredictionError, Prediction, Predictor, View, checked
from predictor import check
from predictor.evaluation import trial
from predictor.registry import available, load_predictor

FRAME = GridFrame(0.05, (1.0, -2.0), (80, 80))
POSE = np.array([3.0, 0.0, 0.4])


def cluttered(seed: int = 0) -> Grid:
    rng = np.random.default_rng(seed)
    cells = rng.choice(np.array([FREE, OCCUPIED, UNKNOWN], np.int8), FRAME.shape)
    return Grid(FRAME, cells)


def some_prediction(**changes) -> Prediction:
    half = np.full(FRAME.shape, 0.5, np.float32)
    return dataclasses.replace(Prediction(FRAME, half, half, half), **changes)


def test_a_view_needs_a_cell_and_a_pose_of_numbers():
    empty = Grid(GridFrame(0.05, (0.0, 0.0), (0, 0)), np.zeros((0, 0), np.int8))
    with pytest.raises(ValueError, match="empty"):
        View(empty, POSE)
    with pytest.raises(ValueError, match="finite"):
        View(cluttered(), np.array([0.0, np.nan, 0.0]))


def test_a_view_of_a_map_shows_the_two_squares_around_the_robot():
    known = cluttered()
    view = View.of(known, POSE, 2.0, 6.0)
    assert (view.known.frame.size, view.around.frame.size) == ((2.0, 2.0), (6.0, 6.0))
    assert np.array_equal(view.around.crop(view.known.frame).cells, view.known.cells)
    assert np.array_equal(view.around.crop(known.frame).cells, known.cells)


def test_a_view_without_a_larger_map_shows_the_square_to_predict_as_such():
    for view in (View(cluttered(), POSE), View.of(cluttered(), POSE, 2.0, 0.0)):
        assert view.around is view.known


@pytest.mark.parametrize("name", available())
def test_every_registered_predictor_keeps_the_contract(name):
    predictor = load_predictor(name)
    assert isinstance(predictor, Predictor)
    check_predictor(predictor)


@pytest.mark.parametrize("name", available())
def test_every_registered_predictor_keeps_what_was_observed(name):
    known = cluttered()
    prediction = load_predictor(name).predict(View(known, POSE))
    seen = ~known.unknown
    assert np.array_equal(prediction.p_free[seen], known.free[seen])
    assert np.array_equal(prediction.p_occupied[seen], known.occupied[seen])
    assert (prediction.confidence[seen] == 1).all()


@pytest.mark.parametrize("name", available())
def test_no_registered_predictor_is_sure_of_a_map_in_which_nothing_was_seen(name):
    known = Grid(FRAME, np.full(FRAME.shape, UNKNOWN, np.int8))
    assert (load_predictor(name).predict(View(known, POSE)).confidence < 0.5).all()


def test_no_prediction_has_no_confidence_in_unknown_cells():
    known = cluttered()
    prediction = load_predictor("none").predict(View(known, POSE))
    for values in (prediction.p_free, prediction.p_occupied, prediction.confidence):
        assert not values[known.unknown].any()


def test_checked_puts_observed_cells_back():
    known = cluttered()
    prediction = checked(some_prediction(), known)
    assert np.array_equal(prediction.p_free == 1, known.free)
    assert np.array_equal(prediction.p_occupied == 1, known.occupied)
    assert (prediction.confidence[known.unknown] == 0.5).all()


def test_a_number_that_changes_when_it_is_read_is_read_once():
    class Fickle(float):
        def __float__(self):
            self.readings = getattr(self, "readings", 0) + 1
            return 2.0 if self.readings == 1 else 0.0

    assert checked(some_prediction(doubt=Fickle()), cluttered()).doubt == 2.0


def test_a_doubt_is_kept():
    assert checked(some_prediction(doubt=np.float32(2.5)), cluttered()).doubt == 2.5
    assert checked(some_prediction(), cluttered()).doubt == 1.0


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
        ({"doubt": 0.9}, "doubt is 0.9"),
        ({"doubt": np.nan}, "doubt is nan"),
        ({"doubt": np.inf}, "doubt is inf"),
        ({"doubt": "2"}, "doubt is '2'"),
        ({"doubt": 10**400}, "doubt is 1000"),
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
    def predict(self, view):
        view.known.cells[:] = FREE
        return load_predictor("none").predict(view)


class Dithers:
    def __init__(self):
        self.calls = 0

    def predict(self, view):
        known = view.known
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


class Claims:
    """All that was not seen is free, with a confidence; NaN in the first cells of each row."""

    def __init__(self, confidence=1.0, nan=0, seconds=0.0):
        self.confidence, self.nan, self.seconds = confidence, nan, seconds

    def predict(self, view):
        known = view.known
        time.sleep(self.seconds)
        ones = np.ones(known.frame.shape)
        confidence = self.confidence * ones
        confidence[:, : self.nan] = np.nan
        return Prediction(known.frame, ones, 0 * ones, confidence)


class Remembers:
    """Its first four answers are others than all that follow."""

    def __init__(self):
        self.calls = 0

    def predict(self, view):
        self.calls += 1
        return Claims(0.5 if self.calls <= 4 else 0.25).predict(view)


def test_check_predictor_warns_of_what_a_drive_would_suffer_from():
    assert check_predictor(Claims(0.9)) == ()
    for predictor, said in [
        (Claims(1.0), "certainty about"),
        (Claims(0.5, nan=3), "NaN in"),
        (Claims(0.5, seconds=0.11), "an answer took"),
        (Remembers(), "what was asked before"),
    ]:
        [warning] = check_predictor(predictor)
        assert said in warning


def test_the_example_in_the_readme_keeps_the_contract():
    text = (Path(__file__).parents[2] / "README.md").read_text()
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    [example] = [block for block in blocks if "class MyPredictor" in block]
    names = {}
    exec(example, names)
    assert check_predictor(names["MyPredictor"]()) == ()


def test_nan_in_every_cell_breaks_the_contract():
    with pytest.raises(BadPredictionError, match="NaN in every cell"):
        check_predictor(Claims(0.5, nan=1000))


def test_what_raises_breaks_the_contract_whatever_it_raises():
    class Exits:
        def predict(self, view):
            raise SystemExit(0)

    with pytest.raises(BadPredictionError, match="raised SystemExit"):
        check_predictor(Exits())


def test_the_command_prints_warnings_and_says_with_its_status_what_is_broken(capsys, monkeypatch):
    # What it finds in drives is tested in tests/predictor/test_trial.py.
    monkeypatch.setattr(trial, "tried", lambda *_: trial.Trial(promises=1, times=[0.0]))
    assert check.main(["none"]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert last == "none: keeps to the contract and is fit to drive with, 0 warnings"
    assert check.main(["test_prediction:Claims"]) == 0
    assert "warning: certainty about" in capsys.readouterr().out
    assert check.main(["test_prediction:Overwrites"]) == 1
    assert "error: predict() changed the map" in capsys.readouterr().out
    for exits in ("sys:exit", "no_such_module:Predictor"):
        assert check.main([exits]) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_a_doubt_that_changes_from_call_to_call_breaks_the_contract():
    class Wavering:
        def __init__(self):
            self.doubt = 1.0

        def predict(self, view):
            self.doubt += 1.0
            values = np.full(view.known.frame.shape, 0.3, np.float32)
            return Prediction(view.known.frame, values, values, values, doubt=self.doubt)

    with pytest.raises(BadPredictionError, match="two answers"):
        check_predictor(Wavering())
