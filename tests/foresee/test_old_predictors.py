"""Predictors of the form before `View` work until version 2, and their users are warned."""

import warnings

import numpy as np
import pytest
from short_drive import drive, navigator, straight

from foresee.checking import check_predictor
from foresee.mapping.grid import UNKNOWN, Grid, GridFrame
from foresee.prediction import BadPredictionError, Caller, Prediction, View
from planner.risk.ask_predictor import Asker
from predictor.registry import PredictorError, load_predictor
from sim.episode import EpisodeConfig

FRAME = GridFrame(0.05, (1.0, -2.0), (80, 80))
POSE = np.array([3.0, 0.0, 0.4])
VIEW = View(
    Grid(FRAME, np.full(FRAME.shape, UNKNOWN, np.int8)),
    POSE,
    Grid(GridFrame(0.05, (-3.0, -6.0), (240, 240)), np.full((240, 240), UNKNOWN, np.int8)),
)


def half(known):
    values = np.full(known.frame.shape, 0.5, np.float32)
    return Prediction(known.frame, values, values, values)


class New:
    def predict(self, view):
        return half(view.known)


class NewWithAnOption:
    def predict(self, view, scale=1.0):
        assert scale == 1.0
        return half(view.known)


class NewWithAnyArguments:
    def predict(self, *arguments):
        (view,) = arguments
        return half(view.known)


class Two:
    def predict(self, known, pose):
        assert pose.shape == (3,)
        return half(known)


class Renamed:
    def predict(self, grid, where):
        assert where.shape == (3,)
        return half(grid)


class PoseByDefault:
    def predict(self, known, pose=None):
        assert pose is not None
        return half(known)


class Three:
    context_side = 12.0

    def predict(self, known, pose, around):
        assert around.frame.size == (12.0, 12.0)
        return half(known)


class ThreeOrTwo:
    context_side = 12.0

    def __init__(self):
        self.given = []

    def predict(self, known, pose, around=None):
        self.given.append(around)
        return half(known)


OLD = [Two, Renamed, PoseByDefault, Three, ThreeOrTwo]


@pytest.mark.parametrize("kind", [New, NewWithAnOption, NewWithAnyArguments])
def test_a_predictor_of_a_view_is_called_with_a_view_and_without_a_warning(kind):
    with warnings.catch_warnings(action="error"):
        caller = Caller(kind())
    assert not caller.is_old
    assert caller.context_side == 40.0
    assert (caller.ask(VIEW).p_free == 0.5).all()


@pytest.mark.filterwarnings("ignore:.* has predict:DeprecationWarning")
@pytest.mark.parametrize("kind", OLD)
def test_a_predictor_of_the_old_form_gets_what_it_takes(kind):
    caller = Caller(kind())
    assert caller.is_old
    assert caller.context_side == getattr(kind, "context_side", 0.0)
    assert (caller.ask(VIEW).p_free == 0.5).all()


@pytest.mark.filterwarnings("ignore:.* has predict:DeprecationWarning")
def test_without_a_larger_map_the_old_form_is_called_with_two_arguments():
    predictor = ThreeOrTwo()
    Caller(predictor).ask(View(VIEW.known, POSE))
    assert predictor.given == [None]
    with pytest.raises(BadPredictionError, match=r"predict\(\) of Three raised TypeError"):
        Caller(Three()).ask(View(VIEW.known, POSE))


def test_the_user_is_warned_once_for_each_class_and_not_at_each_call():
    class Old(Two):
        pass

    class AlsoOld(Two):
        pass

    with warnings.catch_warnings(record=True, action="always") as caught:
        asker = Asker(Old())
        for _ in range(3):
            asker.ask(VIEW, 10.0)
        Caller(Old())
    assert [warning.category for warning in caught] == [DeprecationWarning]
    assert "Old has predict(known, pose)" in str(caught[0].message)
    with pytest.warns(DeprecationWarning, match="AlsoOld"):
        Caller(AlsoOld())


@pytest.mark.filterwarnings("ignore:.* has predict:DeprecationWarning")
def test_a_drive_with_the_old_form_is_the_same():
    trusting = {"reliance": 0.6, "steer": True}
    old, new = (
        drive(task, navigator(task, kind(), **trusting), EpisodeConfig(timeout=1.0))
        for task, kind in ((straight(), Two), (straight(), New))
    )
    assert np.array_equal(old.trace["states"], new.trace["states"])
    assert not any(name.startswith("predictor") for name in old.faults)


@pytest.mark.filterwarnings("ignore:.* has predict:DeprecationWarning")
def test_check_predictor_says_that_the_form_is_old():
    assert check_predictor(New()) == ()
    [warning] = check_predictor(ThreeOrTwo())
    assert "will not work in version 2" in warning


class TwoWithAContext:
    context_side = 12.0

    def predict(self, known, pose):
        raise NotImplementedError


class Four:
    def predict(self, known, pose, around, more):
        raise NotImplementedError


@pytest.mark.parametrize("kind", [TwoWithAContext, Four])
def test_what_has_neither_form_is_refused(kind):
    with pytest.raises(BadPredictionError, match=r"it must be predict\(view\) -> Prediction"):
        Caller(kind())
    with pytest.raises(PredictorError, match=r"it must be predict\(view\) -> Prediction"):
        load_predictor(f"{__name__}:{kind.__name__}")
