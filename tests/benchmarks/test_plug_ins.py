"""A predictor in a file of the user's, driven by the command."""

import pytest
from comparison import python, results

PLUG_IN = '''
import numpy as np

from foresee.prediction import Prediction


class MyPredictor:
    """Believes that everything goes on being free, a little."""

    def predict(self, view):
        known = view.known
        free = known.free.astype(np.float32)
        free[known.unknown] = 0.6
        return Prediction(
            frame=known.frame,
            p_free=free,
            p_occupied=known.occupied.astype(np.float32),
            confidence=np.ones(known.frame.shape, np.float32),
        )
'''


@pytest.mark.slow(11)
def test_a_plug_in_in_a_file_of_ones_own_runs_from_any_folder(short_map, tmp_path):
    (tmp_path / "my_module.py").write_text(PLUG_IN)
    done = python(
        "-m",
        "benchmarks.corridor",
        "--predictor",
        "my_module:MyPredictor",
        "--world",
        short_map,
        "--arms",
        "predicted",
        "--reliance",
        0.5,
        "--episodes",
        2,
        "--jobs",
        2,
        "--out",
        "run",
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    r = results(tmp_path / "run")
    assert r["settings"]["predictor"] == "my_module:MyPredictor"
    assert len(r["episodes"]) == 2
    for episode in r["episodes"]:
        assert not any(kind.startswith("predictor") for kind in episode["faults"])
        assert episode["promises"] > 0


STUDENT = '''
from predictor.none import NoPrediction
from foresee.mapping.grid import world_hash
from sim.map_server import load_world
from sim.world import sealed


class Student(NoPrediction):
    """Has learned from the very building that it is asked about."""

    def __init__(self):
        cells = sealed(load_world({path!r})).grid.cells
        self.facts = {{"worlds": [world_hash(cells)], "fingerprint": {fingerprint!r}}}
'''


@pytest.mark.slow(9)
def test_buildings_learned_from_and_other_weights_are_noticed(short_map, tmp_path):
    def go(fingerprint, text=None):
        text = text or STUDENT.format(path=str(short_map), fingerprint=fingerprint)
        (tmp_path / "school.py").write_text(text)
        return python(
            "-m",
            "benchmarks.corridor",
            "--predictor",
            "school:Student",
            "--world",
            short_map,
            "--arms",
            "known,predicted",
            "--episodes",
            1,
            "--jobs",
            1,
            "--out",
            "run",
            cwd=tmp_path,
        )

    first = go("one")
    assert first.returncode == 0, first.stderr
    assert "was trained or validated in the buildings of 1 episode" in first.stdout
    learned = {e["arm"]: e["learned"] for e in results(tmp_path / "run")["episodes"]}
    assert learned == {"known": False, "predicted": True}
    second = go("two")
    assert second.returncode == 2
    assert "and one; choose another place" in second.stderr
    first = STUDENT.format(path=str(short_map), fingerprint="one")
    third = go("one", "# another version of its code\n" + first)
    assert third.returncode == 2
    assert "and one; choose another place" in third.stderr
