"""Which levels a calibration certifies, and for which planner."""

from dataclasses import replace

import pytest
from calibrations import written

from benchmarks.calibration import certificate, learn_then_test
from benchmarks.calibration.certificate import at_risk, conditions_for
from benchmarks.calibration.settings import CalibrateSettings
from benchmarks.runs.settings import Settings
from benchmarks.runs.statistics import wilson
from planner.risk.calibration import CalibrationError

OUTCOMES = {True: "collided", False: "reached"}
SETTINGS = Settings(world=("corridor", "narrow"), predictor="none")


def certified(tmp_path, monkeypatch, collides, **asked):
    """Calibrate with drives that collide where `collides(level, index)` says so."""

    def driven(settings, weights, index):
        return {
            "index": index,
            "place": "corridor",
            "learned": False,
            "outcome": OUTCOMES[collides(settings.level, index)],
            "time": 10.0,
            "path_length": 20.0,
            "world": f"{index}",
            "commit": "c",
        }

    monkeypatch.setattr(learn_then_test, "_driven", driven)
    return learn_then_test.calibrate(SETTINGS, CalibrateSettings(**asked), tmp_path, jobs=1)


def test_no_level_is_certified_beyond_the_first_that_is_not(tmp_path, monkeypatch):
    """The order of the tests takes the place of a correction for their number."""
    asked = {"risks": (0.05, 0.3), "levels": (0.001, 0.01, 0.1), "drives": 100}
    # Of a level in the middle, every sixth drive collides: too often for one of the risks.
    found = certified(tmp_path, monkeypatch, lambda level, i: level == 0.01 and i % 6 == 0, **asked)
    assert found["certified"] == {"0.05": 0.001, "0.3": 0.1}


def test_the_tests_end_when_no_risk_is_left(tmp_path, monkeypatch):
    asked = {"risks": (0.1, 0.3), "levels": (0.001, 0.01, 0.1), "drives": 100}
    found = certified(tmp_path, monkeypatch, lambda level, _: level == 0.001, **asked)
    assert found["certified"] == {}
    assert [entry["level"] for entry in found["levels"]] == [0.001]


def test_a_risk_stays_certified_while_a_smaller_one_is_still_tested(tmp_path, monkeypatch):
    asked = {"risks": (0.02, 0.5), "levels": (0.01,), "drives": 400}
    found = certified(tmp_path, monkeypatch, lambda _, index: index >= 8, **asked)
    assert found["certified"] == {"0.5": 0.01}


@pytest.mark.parametrize("part", ["mpc", "guide", "car"])
def test_a_calibration_of_a_planner_with_other_settings_is_refused(part, tmp_path, monkeypatch):
    conditions = conditions_for(SETTINGS)
    path = written(tmp_path / "c.json", conditions=conditions, certified={"0.05": 0.01})
    asked = replace(SETTINGS, risk=0.05)
    assert at_risk(asked, path).level == 0.01
    usual = certificate.navigator_config

    def other(*args):
        config = usual(*args)
        settings = getattr(config, part)
        name, value = next(
            (name, value) for name, value in vars(settings).items() if isinstance(value, float)
        )
        return replace(config, **{part: replace(settings, **{name: 1.01 * value})})

    monkeypatch.setattr(certificate, "navigator_config", other)
    with pytest.raises(CalibrationError, match="is for planner"):
        at_risk(asked, path)


def test_only_collisions_count_as_losses(tmp_path, monkeypatch):
    asked = {"risks": (0.05,), "levels": (0.01,), "drives": 100}
    monkeypatch.setitem(OUTCOMES, False, "stuck")
    assert certified(tmp_path, monkeypatch, lambda *_: False, **asked)["certified"] == {
        "0.05": 0.01
    }


def test_the_conditions_do_not_depend_on_the_level_in_use():
    assert conditions_for(replace(SETTINGS, level=0.01)) == conditions_for(SETTINGS)


def test_the_table_says_what_was_driven_and_what_each_level_is_certified_for(tmp_path, monkeypatch):
    asked = {"risks": (0.05, 0.3), "levels": (0.001, 0.01, 0.1), "drives": 100}
    found = certified(tmp_path, monkeypatch, lambda level, i: level == 0.1 and i % 9 == 0, **asked)
    assert found["certified"] == {"0.05": 0.01, "0.3": 0.1}
    for entry in found["levels"]:
        collided, drives = entry["collided"], entry["drives"]
        assert entry["nominal_interval"] == pytest.approx(wilson(collided, drives))
        assert entry["km"] == pytest.approx(0.02 * drives)
        assert entry["speed"] == pytest.approx(2.0)
    lines = learn_then_test.table(found).splitlines()[2:]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    assert [(line[0], line[-1]) for line in cells] == [
        ("0.001", "0.05, 0.3"),
        ("0.01", "0.05, 0.3"),
        ("0.1", "0.3"),
    ]
