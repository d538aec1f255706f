"""The trial of a predictor says what is wrong with it in use."""

import re
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from foresee.infra.plug_in import load_plug_in
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from foresee.prediction import BadPredictionError, Prediction, View
from predictor import check
from predictor.evaluation import trial
from predictor.evaluation.trial import Trial, tasks, tried
from predictor.recording.settings import LEARNED
from sim.task import NoTaskError
from sim.world import World

ROOT = Path(__file__).parents[2]
PAGES = {"MyPredictor": "README.md", "Optimist": "docs/tutorial/plug_in_a_predictor.md"}


@pytest.fixture
def pages(tmp_path, monkeypatch):
    """A module with the plug-ins of the pages, from which the command can load them."""
    blocks = [
        block
        for name, page in PAGES.items()
        for block in re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(), re.DOTALL)
        if f"class {name}" in block
    ]
    (tmp_path / "plug_ins_of_pages.py").write_text("\n".join(blocks))
    monkeypatch.syspath_prepend(tmp_path)


@pytest.fixture(scope="module")
def four_tasks():
    return list(islice(tasks(), 4))


@pytest.fixture
def short(four_tasks, monkeypatch):
    """Short drives, in four buildings."""
    monkeypatch.setattr(trial, "tasks", lambda: four_tasks)
    monkeypatch.setattr(trial, "SECONDS", 2.0)


class Says:
    """The same in each unobserved cell."""

    def __init__(self, p_free, confidence=1.0):
        self.p_free, self.confidence = p_free, confidence

    def predict(self, view):
        ones = np.ones(view.known.frame.shape)
        return Prediction(view.known.frame, self.p_free * ones, 0 * ones, self.confidence * ones)


def scored(predictor, free_cells):
    """A trial of one prediction, of a row of cells of which the last are unobserved.

    Args:
        predictor: the predictor.
        free_cells: which of the unobserved cells are free.
    """
    frame = GridFrame(0.05, (0.0, 0.0), (1, 2 + len(free_cells)))
    true = np.array([[FREE, FREE, *np.where(free_cells, FREE, OCCUPIED)]], np.int8)
    seen = true.copy()
    seen[0, 2:] = UNKNOWN
    view = View(Grid(frame, seen), np.zeros(3))
    measured = Trial(times=[0.001])
    measured.add(view, predictor.predict(view), World("row", Grid(frame, true)))
    return measured


def test_trusted_cells_and_scores_are_those_of_the_unobserved_cells():
    measured = scored(Says(0.96), [True] * 3 + [False])
    assert (measured.trusted, measured.blocked) == (4, 1)
    assert measured.share_free == 0.75
    own = measured.own.measures()
    assert own["brier_free"] == pytest.approx((3 * 0.04**2 + 0.96**2) / 4)
    assert own["ece_free"] == pytest.approx(0.96 - 0.75)
    assert scored(Says(0.94), [True]).trusted == 0
    assert scored(Says(1.0, confidence=0.9), [True]).trusted == 0
    # A confidence of 0 means unknown: the cells do not count.
    assert np.isnan(scored(Says(0.5, confidence=0.0), [True]).share_free)


@pytest.mark.parametrize(
    ("broken", "promises", "errors", "warnings"),
    [
        *((0, 100, 0, 0), (10, 100, 0, 0), (11, 100, 0, 1), (25, 100, 0, 1), (26, 100, 1, 0)),
        *((20, 20, 1, 0), (19, 19, 0, 1)),
    ],
)
def test_broken_promises_are_blamed_by_their_share(broken, promises, errors, warnings):
    measured = scored(Says(0.75), [True] * 3 + [False])
    measured.own.brier_free[:] = 0.0  # not its fault
    measured.promises, measured.broken = promises, broken
    assert [len(measured.errors()), len(measured.warnings())] == [errors, warnings]
    for line in measured.errors() + measured.warnings():
        assert f"it broke {broken} of {promises} promises" in line


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({}, None),
        ({"promises": 0}, "makes no promises"),
        ({"times": [0.001] * 9 + [0.06] * 2}, "takes up to 60 ms of processor time"),
    ],
)
def test_what_should_be_better_is_named(change, said):
    measured = scored(Says(0.75), [True] * 3 + [False])
    measured.own.brier_free[:] = 0.0
    measured.promises = 100
    for name, value in change.items():
        setattr(measured, name, value)
    lines = measured.warnings()
    assert len(lines) == (said is not None)
    assert all(said in line for line in lines)


def test_wrong_probabilities_are_named_with_the_share_that_is_free():
    measured = scored(Says(0.2), [True] * 3 + [False])
    measured.promises = 100
    constant, off = measured.warnings()
    assert "its Brier score is 0.490, and 0.188 if p_free is 0.75" in constant
    assert "off by 0.55 on average: of the cells with a p_free of about 0.20, 75 % are free" in off


def test_the_drives_are_in_held_out_buildings_of_every_kind_that_networks_learn_from(monkeypatch):
    drawn = []
    monkeypatch.setattr(trial, "generate", lambda *building: drawn.append(building) or building)

    def task_in_world(building, seed):
        if seed == 540_001:
            raise NoTaskError("no route")
        return building

    monkeypatch.setattr(trial, "task_in_world", task_in_world)
    assert list(tasks()) == [building for building in drawn if building[1] != 540_001]
    assert len(drawn) == trial.BUILDINGS + 1
    assert drawn == [(LEARNED[n % len(LEARNED)], 540_000 + n) for n in range(len(drawn))]


def test_a_predictor_that_fails_in_a_drive_breaks_the_contract(short):
    class FailsLater:
        calls = 0

        def predict(self, view):
            self.calls += 1
            if self.calls > 3:
                raise RuntimeError("no more")
            return Says(0.5).predict(view)

    with pytest.raises(BadPredictionError, match="no more"):
        tried(FailsLater(), lambda: None)


def test_the_command_does_not_blame_the_predictor_of_the_readme(pages, short, capsys):
    assert check.main(["plug_ins_of_pages:MyPredictor"]) == 0
    said = capsys.readouterr().out.splitlines()
    [row] = [line for line in said if "promises broken" in line]
    assert "–" not in row
    assert said[-1].endswith("keeps to the contract and is fit to drive with, 0 warnings")


def test_the_command_blames_a_bold_predictor(pages, short, capsys):
    assert check.main(["plug_ins_of_pages:Bold"]) == 1
    said = capsys.readouterr().out
    assert re.search(r"error: it broke \d+ of \d+ promises", said)
    assert "is not fit to drive with" in said


def test_a_trial_gives_the_same_result_again(pages, short, four_tasks, monkeypatch):
    monkeypatch.setattr(trial, "tasks", lambda: four_tasks[1:2])
    predictor = load_plug_in("plug_ins_of_pages:Bold", "predictor")()
    first, second = (tried(predictor, lambda: None) for _ in range(2))
    assert first.promises > 0
    assert (first.promises, first.broken) == (second.promises, second.broken)
    assert (first.trusted, first.blocked) == (second.trusted, second.blocked)
