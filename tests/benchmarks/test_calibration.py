"""Calibrations: what they certify, for whom, and whom they refuse."""

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from calibrations import SETTINGS, proof, written

from benchmarks import calibrate, tables
from benchmarks.calibration import learn_then_test
from benchmarks.calibration.certificate import SHIPPED, at_risk, conditions_for
from benchmarks.calibration.settings import CalibrateSettings
from benchmarks.runs.drive_file import read_drives
from benchmarks.runs.settings import Settings
from foresee.infra.command_line import UsageError
from planner.revision import FIRST, REVISION, revision_of
from planner.risk.calibration import Calibration, CalibrationError
from sim import empty_straight, save_world


def test_a_risk_is_given_the_level_of_the_largest_certified_risk_below_it(tmp_path):
    found = Calibration.load(written(tmp_path / "c.json"))
    levels = [found.level_at(risk) for risk in (0.02, 0.03, 0.05, 0.5)]
    assert levels == [0.003, 0.003, 0.01, 0.01]


def test_a_smaller_risk_than_any_certified_one_is_refused(tmp_path):
    found = Calibration.load(written(tmp_path / "c.json"))
    with pytest.raises(
        CalibrationError, match=r"no risk as small as 0.01; it certifies 0.02, 0.05"
    ):
        found.level_at(0.01)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"v_max": 5.0}, "v_max"),
        ({"vehicle": "reeds-shepp"}, "vehicle"),
        ({"predictor": "extend"}, "predictor"),
        ({"window": 7.5}, "window"),
        ({"route": "fixed"}, "route"),
        ({"reliance": 0.1}, "reliance"),
        ({"noise": 0.02}, "noise"),
        ({"world": ("corridor", "trap")}, "world"),
    ],
)
def test_a_calibration_of_other_drives_is_refused(change, named, tmp_path):
    found = written(tmp_path / "c.json")
    settings = Settings(**({"world": ("corridor",), "predictor": "none", "risk": 0.05} | change))
    with pytest.raises(CalibrationError, match=f"is for {named}"):
        at_risk(settings, found)


def test_a_calibration_of_another_planner_is_refused(tmp_path):
    found = written(tmp_path / "c.json", conditions=conditions_for(SETTINGS) | {"planner": "other"})
    with pytest.raises(CalibrationError, match="is for planner other"):
        at_risk(replace(SETTINGS, risk=0.05), found)


@pytest.mark.parametrize("world", [("narrow",), ("corridor", "office", "narrow"), ()])
def test_the_certificate_is_for_the_same_mixture(world, tmp_path):
    settings = Settings(world=world, predictor="none", risk=0.05)
    with pytest.raises(CalibrationError, match="is for world corridor, narrow"):
        at_risk(settings, written(tmp_path / "c.json"))
    other_order = Settings(world=("narrow", "corridor"), predictor="none", risk=0.05)
    assert at_risk(other_order, written(tmp_path / "c.json")).level == 0.01


def test_a_calibration_that_does_not_name_all_conditions_is_refused(tmp_path):
    found = written(tmp_path / "c.json", conditions={"world": ["corridor"]})
    with pytest.raises(CalibrationError, match="is for"):
        at_risk(Settings(predictor="none", risk=0.05), found)


def test_the_certificate_is_for_maps_with_the_same_cells(tmp_path):
    path = tmp_path / "map.yaml"
    save_world(empty_straight(20.0, 3.0), path)
    settings = Settings(world=(str(path),), predictor="none", risk=0.05)
    found = written(tmp_path / "c.json", conditions=conditions_for(settings))
    assert at_risk(settings, found).level == 0.01
    save_world(empty_straight(20.0, 2.5), path)
    with pytest.raises(CalibrationError, match="is for maps"):
        at_risk(settings, found)


def test_a_calibration_knows_the_buildings_that_it_was_made_in(tmp_path):
    found = Calibration.load(written(tmp_path / "c.json"))
    asked = [(0, 100), (0, 101), (299, 5), (300, 5)]
    assert [found.has_used(*one) for one in asked] == [False, True, True, False]
    # Buildings without a task are not among the drives that are counted.
    found = Calibration.load(written(tmp_path / "c.json", most_drives=250))
    assert [found.has_used(*one) for one in [(349, 5), (350, 5)]] == [True, False]


def test_a_risk_is_refused_in_the_buildings_of_its_calibration(tmp_path):
    found = written(tmp_path / "c.json")
    # 7 tasks in two families are in buildings of seeds 98 to 101; the calibration began with 100.
    settings = replace(SETTINGS, risk=0.05, seed=98, episodes=7)
    with pytest.raises(CalibrationError, match="same buildings: choose another --seed"):
        at_risk(settings, found)
    assert at_risk(replace(settings, uncertified=True), found).uncertified
    assert not at_risk(replace(settings, episodes=4), found).uncertified


@pytest.mark.parametrize("risky", [{"risk": 0.05}, {"level": 0.05}])
def test_a_planner_that_takes_everything_for_free_has_no_level(risky):
    with pytest.raises(UsageError, match="--reliance below 1"):
        Settings(reliance=1.0, **risky)


def test_a_risk_without_a_calibration_is_refused():
    with pytest.raises(UsageError, match="make one with `foresee calibrate"):
        at_risk(Settings(risk=0.05))


def test_without_risk_no_calibration_is_needed(tmp_path):
    assert at_risk(SETTINGS, tmp_path / "missing.json") == SETTINGS


def test_risk_and_level_exclude_each_other(tmp_path):
    with pytest.raises(UsageError, match="--level is in place of --risk"):
        at_risk(Settings(risk=0.05, level=0.01), written(tmp_path / "c.json"))


@pytest.mark.parametrize("text", ["", "{", "[]", '{"kind": "attack"}', '{"kind": "calibration"}'])
def test_a_file_that_is_no_calibration_is_refused_in_one_line(text, tmp_path):
    path = tmp_path / "c.json"
    path.write_text(text)
    with pytest.raises(CalibrationError, match="is no calibration") as caught:
        Calibration.load(path)
    assert "\n" not in str(caught.value)


def collides(share):
    """Return a stand-in for drives, of which a share collides that is the level times `share`."""

    def driven(settings, weights, index):
        bad = ((index + 0.5) * 0.618034) % 1.0 < share * settings.level
        return {
            "index": index,
            "place": settings.world[index % len(settings.world)],
            "learned": False,
            "world": f"{index}",
            "outcome": "collided" if bad else "reached",
            "time": 10.0,
            "path_length": 20.0,
            "commit": "c",
        }

    return driven


LEVELS = CalibrateSettings(levels=(0.001, 0.02, 0.2, 0.0001), drives=600)


def test_levels_are_certified_from_safe_to_bold_until_one_is_not(tmp_path, monkeypatch):
    monkeypatch.setattr(learn_then_test, "_driven", collides(1.0))
    found = learn_then_test.calibrate(SETTINGS, LEVELS, tmp_path, jobs=1)
    assert found["certified"] == {"0.02": 0.001, "0.05": 0.02}
    assert [entry["level"] for entry in found["levels"]] == [0.0001, 0.001, 0.02, 0.2]
    assert (found["sequence"], found["most_drives"]) == ([0.0001, 0.001, 0.02, 0.2], 600)
    # A safe level needs few drives; a hopeless one is given up early.
    assert found["levels"][0]["drives"] == 177
    assert found["levels"][3]["drives"] < 60
    loaded = Calibration.load(tmp_path / "calibration.json")
    assert loaded.levels == {0.02: 0.001, 0.05: 0.02}
    again = learn_then_test.calibrate(SETTINGS, LEVELS, tmp_path, jobs=1)
    assert again["levels"] == found["levels"]


def test_drives_that_are_there_beyond_the_decision_change_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(learn_then_test, "_driven", collides(1.0))
    asked = replace(LEVELS, drives=300)
    few = learn_then_test.calibrate(SETTINGS, asked, tmp_path / "few", jobs=1)
    # As many workers leave them.
    decided = learn_then_test.decided_after
    monkeypatch.setattr(learn_then_test, "decided_after", lambda *_: None)
    learn_then_test.calibrate(SETTINGS, asked, tmp_path / "all", jobs=1)
    monkeypatch.setattr(learn_then_test, "decided_after", decided)
    path = tmp_path / "all/level-0.2.json"
    assert len(read_drives(path, learn_then_test.KIND_OF_DRIVES)["drives"]) == 300
    again = learn_then_test.calibrate(SETTINGS, asked, tmp_path / "all", jobs=1)
    assert again["levels"] == few["levels"]
    assert again["certified"] == few["certified"]


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"levels": (0.001, 0.03)}, "levels"),
        ({"confidence": 0.8}, "confidence"),
        ({"seed": 1}, "seed"),
    ],
)
def test_a_folder_accepts_no_other_levels_later(change, named, tmp_path, monkeypatch):
    monkeypatch.setattr(learn_then_test, "_driven", collides(1.0))
    learn_then_test.calibrate(SETTINGS, LEVELS, tmp_path, jobs=1)
    with pytest.raises(UsageError, match=named):
        learn_then_test.calibrate(SETTINGS, replace(LEVELS, **change), tmp_path, jobs=1)
    learn_then_test.calibrate(SETTINGS, replace(LEVELS, drives=700), tmp_path, jobs=1)


def test_a_calibration_records_the_revision_of_its_drives_and_continues_no_other(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(learn_then_test, "_driven", collides(1.0))
    learn_then_test.calibrate(SETTINGS, LEVELS, tmp_path, jobs=1)
    assert Calibration.load(tmp_path / "calibration.json").revision == revision_of(SETTINGS.route)
    monkeypatch.setattr(learn_then_test, "revision_of", lambda route: REVISION + 1)
    with pytest.raises(UsageError, match="revision"):
        learn_then_test.calibrate(SETTINGS, LEVELS, tmp_path, jobs=1)


def test_a_calibration_without_a_revision_is_of_the_first(tmp_path):
    path = written(tmp_path / "c.json")
    assert at_risk(replace(SETTINGS, risk=0.05), path).calibrated == FIRST
    path = written(tmp_path / "c.json", revision=7)
    assert at_risk(replace(SETTINGS, risk=0.05), path).calibrated == 7


def test_a_folder_accepts_no_drives_of_another_planner(tmp_path, monkeypatch):
    monkeypatch.setattr(learn_then_test, "_driven", collides(1.0))
    learn_then_test.calibrate(SETTINGS, LEVELS, tmp_path, jobs=1)
    other = conditions_for(SETTINGS) | {"planner": "other"}
    monkeypatch.setattr(learn_then_test, "conditions_for", lambda _: other)
    with pytest.raises(UsageError, match="planner"):
        learn_then_test.calibrate(SETTINGS, LEVELS, tmp_path, jobs=1)


def test_the_kind_of_building_is_drawn_anew_for_each_drive(monkeypatch):
    def attempted(settings, weights, item):
        return f"{settings.world} {settings.seed}"

    monkeypatch.setattr(learn_then_test, "attempt", attempted)
    drives = [learn_then_test._driven(replace(SETTINGS, seed=100), None, i) for i in range(400)]
    assert drives[7]["note"] == f"('{drives[7]['place']}',) 107"
    corridors = [drive["place"] == "corridor" for drive in drives]
    assert 160 < sum(corridors) < 240
    # In turn, they would change each time.
    assert 160 < sum(a == b for a, b in pairwise(corridors)) < 240


def test_buildings_that_the_predictor_has_learned_from_are_refused(tmp_path, monkeypatch):
    driven = collides(0.0)
    monkeypatch.setattr(learn_then_test, "_driven", lambda *a: driven(*a) | {"learned": True})
    with pytest.raises(UsageError, match="has learned from these buildings"):
        learn_then_test.calibrate(SETTINGS, LEVELS, tmp_path, jobs=1)


def test_buildings_without_a_drive_are_said_to_be_so(tmp_path, monkeypatch):
    none = {"place": "x", "outcome": "no task", "note": "too small"}
    monkeypatch.setattr(learn_then_test, "_driven", lambda s, w, index: none | {"index": index})
    with pytest.raises(UsageError, match="no drive is possible"):
        learn_then_test.calibrate(SETTINGS, LEVELS, tmp_path, jobs=1)


def test_collisions_are_told_for_each_kind_of_building(tmp_path, monkeypatch):
    monkeypatch.setattr(learn_then_test, "_driven", collides(1.0))
    asked = CalibrateSettings(risks=(0.3,), levels=(0.1,), drives=100)
    (entry,) = learn_then_test.calibrate(SETTINGS, asked, tmp_path, jobs=1)["levels"]
    assert entry["by_world"].keys() == {"corridor", "narrow"}
    assert sum(drives for _, drives in entry["by_world"].values()) == entry["drives"]
    assert sum(bad for bad, _ in entry["by_world"].values()) == entry["collided"]
    assert "| 0.1" in learn_then_test.table({"levels": [entry], "certified": {"0.3": 0.1}})


def test_too_few_drives_to_certify_anything_are_refused_before_any_is_made(tmp_path, capsys):
    command = ["--drives", "20", "--risks", "0.05", "--out", str(tmp_path / "run")]
    assert calibrate.main(command) == 2
    assert "--drives 20 cannot certify a risk of 0.05" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


@pytest.mark.slow(6)
def test_a_calibration_drives_and_takes_up_what_it_has(short_map, tmp_path, capsys):
    out = tmp_path / "run"
    command = ["--world", str(short_map), "--risks", "0.45", "--levels", "0.1", "--drives", "12"]
    # As few drives as possible certify the risk.
    command += ["--confidence", "0.5", "--jobs", "1", "--out", str(out)]
    assert calibrate.main(command) == 0
    assert "| 0.1" in capsys.readouterr().out
    before = (out / "level-0.1.json").read_bytes()
    assert tables.main([str(out / "calibration.json"), str(out / "level-0.1.json")]) == 0
    assert capsys.readouterr().out.count("\n| 0.1 ") == 2
    assert calibrate.main(command) == 0
    assert (out / "level-0.1.json").read_bytes() == before
    assert calibrate.main([*command, "--v-max", "3"]) == 2


def edited(**changes):
    """Return the tests of the written calibration, with changes in each."""
    return [test | changes for test in proof({"0.02": 0.003, "0.05": 0.01})]


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"certified": {"0.02": 0.98, "0.05": 0.01}}, "no test at level 0.98"),
        ({"certified": {"0.02": 0.01}}, "at level 0.01 does not certify a risk of 0.02"),
        ({"certified": {"0.001": 0.003}}, "at level 0.003 does not certify a risk of 0.001"),
        ({"certified": {"-5": 0.003}}, "certifies a risk of -5"),
        ({"certified": {"0": 0.003}}, "certifies a risk of 0"),
        ({"certified": {"nan": 0.003}}, "certifies a risk of nan"),
        ({"confidence": 1.0}, "a confidence of 1"),
        ({"confidence": 0.999}, "does not certify"),
        ({"levels": []}, "no test at level 0.003"),
        ({"levels": edited(collided=30)}, "does not certify"),
        ({"levels": edited(drives=20)}, "does not certify"),
        ({"levels": edited(drives=10**30)}, "a test at level 0.003"),
        ({"levels": edited(collided=-1)}, "a test at level 0.003"),
        ({"levels": edited(capital={"0.02": 1e300, "0.05": 1e300})}, "does not certify"),
        ({"levels": edited(capital={"0.02": math.inf, "0.05": math.inf})}, "does not certify"),
        ({"levels": edited(capital={"0.02": math.nan, "0.05": math.nan})}, "does not certify"),
        ({"seed": math.inf}, "cannot convert float infinity"),
        ({"seed": 10**400, "confidence": 10**400}, "int too large|is no calibration"),
    ],
)
def test_a_calibration_that_its_own_tests_do_not_prove_is_refused(tmp_path, changes, says):
    path = written(tmp_path / "c.json", **{"levels": edited()} | changes)
    with pytest.raises(CalibrationError, match=says) as caught:
        Calibration.load(path)
    assert "\n" not in str(caught.value)


def test_a_level_that_failed_below_the_certified_one_is_no_proof(tmp_path):
    tests = edited()
    tests[0]["capital"]["0.05"] = 2.0
    with pytest.raises(CalibrationError, match=r"level 0\.003 does not certify a risk of 0\.05"):
        Calibration.load(written(tmp_path / "c.json", levels=tests))


def test_the_calibrations_that_ship_are_proved_by_their_tests():
    assert len(SHIPPED) == 5
    assert all(Calibration.load(path).levels for path in SHIPPED)


@pytest.mark.parametrize("place", ["/dev/zero", "/dev", "/dev/null"])
def test_what_is_no_file_is_no_calibration(place):
    with pytest.raises(CalibrationError, match=r"is no calibration"):
        Calibration.load(Path(place))


def test_a_file_too_large_for_a_calibration_is_not_read(tmp_path):
    with (tmp_path / "c.json").open("wb") as file:
        file.truncate(2**40)
    with pytest.raises(CalibrationError, match="it has over 10000000 bytes"):
        Calibration.load(tmp_path / "c.json")
