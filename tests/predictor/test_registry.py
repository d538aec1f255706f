"""Predictors by name and by `package.module:Class`."""

import subprocess
import sys
import textwrap

import pytest

from foresee.checking import check_predictor
from predictor.extend import Extend
from predictor.none import NoPrediction
from predictor.registry import PredictorError, available, fingerprint_of, load_predictor

PLUG_IN = """
import numpy as np
from scipy.ndimage import binary_dilation

from foresee.prediction import Prediction


class MyPredictor:
    def predict(self, view):
        known = view.known
        near = binary_dilation(known.free, iterations=10) & ~known.occupied
        return Prediction(
            known.frame,
            p_free=near.astype(np.float32),
            p_occupied=known.occupied.astype(np.float32),
            confidence=np.where(known.unknown, 0.9, 1.0),
        )
"""


def module(folder, monkeypatch, name, text):
    (folder / f"{name}.py").write_text(textwrap.dedent(text))
    monkeypatch.chdir(folder)
    # What one test puts on the path is gone after it.
    monkeypatch.setattr(sys, "path", list(sys.path))


def test_the_names_are_those_that_can_be_loaded():
    assert {"none", "extend"} <= set(available())
    assert isinstance(load_predictor("none"), NoPrediction)
    assert isinstance(load_predictor("extend"), Extend)


def test_a_class_is_loaded_from_its_module():
    assert isinstance(load_predictor("predictor.extend:Extend"), Extend)


def test_a_file_in_the_working_directory_is_a_plug_in(tmp_path, monkeypatch):
    module(tmp_path, monkeypatch, "my_plug_in", PLUG_IN)
    check_predictor(load_predictor("my_plug_in:MyPredictor"))


def test_a_file_is_a_plug_in_from_any_folder_and_program(tmp_path):
    (tmp_path / "my_module.py").write_text(PLUG_IN)
    program = "from predictor.registry import load_predictor as load; load('my_module:MyPredictor')"
    # -P keeps Python itself from looking into the working directory.
    subprocess.run([sys.executable, "-P", "-c", program], cwd=tmp_path, check=True)


def test_a_factory_may_make_the_predictor(tmp_path, monkeypatch):
    module(
        tmp_path,
        monkeypatch,
        "my_factory",
        """
        from predictor.none import NoPrediction
        def make():
            return NoPrediction()
        """,
    )
    assert isinstance(load_predictor("my_factory:make"), NoPrediction)


def test_the_code_of_a_predictor_that_a_package_offers_counts(tmp_path, monkeypatch):
    module(tmp_path, monkeypatch, "my_offered", PLUG_IN)
    offer = tmp_path / "my_offered-1.0.dist-info"
    offer.mkdir()
    (offer / "METADATA").write_text("Metadata-Version: 2.1\nName: my-offered\nVersion: 1.0\n")
    entry = "[foresee.predictors]\nmy-net = my_offered:MyPredictor\n"
    (offer / "entry_points.txt").write_text(entry)
    monkeypatch.syspath_prepend(tmp_path)
    before = fingerprint_of("my-net")
    assert before == fingerprint_of("my_offered:MyPredictor")
    (tmp_path / "my_offered.py").write_text(PLUG_IN.replace("iterations=10", "iterations=9"))
    assert fingerprint_of("my-net") != before
    assert fingerprint_of("extend") is None


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("nope", "'nope': choose one of .*extend.*none.*package.module:Class"),
        ("", "choose one of"),
        ("predictor.none:", "not of the form"),
        (":Class", "not of the form"),
        (".none:NoPrediction", "not of the form"),
        ("no_such_module:Class", "no module no_such_module"),
        ("predictor.no_such:Class", "no module predictor.no_such"),
        ("predictor.none:Nope", "has no Nope"),
        ("foresee.mapping.grid:FREE", "of type int"),
        ("foresee.mapping.grid:GridFrame", "could not be made: TypeError"),
        ("foresee.mapping.body:Body", r"no method predict\(view\)"),
        ("my_broken:A", "importing my_broken: SyntaxError"),
        ("my_needy:A", "importing my_needy: .*no_such_dependency"),
        ("my_raising:A", "could not be made: RuntimeError: two lines"),
        ("my_narrow:A", r"predict\(\), it must be predict\(view\)"),
    ],
)
def test_one_line_says_what_is_wrong(spec, message, tmp_path, monkeypatch):
    module(tmp_path, monkeypatch, "my_broken", "def")
    module(tmp_path, monkeypatch, "my_needy", "import no_such_dependency")
    module(
        tmp_path,
        monkeypatch,
        "my_raising",
        """
        class A:
            def __init__(self):
                raise RuntimeError("two\\nlines")
        """,
    )
    module(
        tmp_path,
        monkeypatch,
        "my_narrow",
        """
        class A:
            def predict(self): ...
        """,
    )
    with pytest.raises(PredictorError, match=message) as raised:
        load_predictor(spec)
    assert "\n" not in str(raised.value)
