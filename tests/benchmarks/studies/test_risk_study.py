"""The study of the risk dial: its series, its independent test, and what it says."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from calibrations import written
from drive_results import a_result

from benchmarks import corridor, tables
from benchmarks.calibration.certificate import conditions_for
from benchmarks.runs.settings import Settings
from benchmarks.runs.summary_text import EARLIER
from benchmarks.studies.risk import __main__ as risk
from benchmarks.studies.risk import series as study
from benchmarks.studies.risk.drives import saved_drives
from benchmarks.studies.risk.figures import _promise
from benchmarks.studies.risk.report import (
    _by_family,
    _times_by_family,
    collision_rows,
    exceeds_its_risk,
    pooled_rows,
)
from benchmarks.studies.risk.series import Series, list_series
from benchmarks.studies.risk.tables import _collision_table
from foresee.checking import check_predictor
from foresee.infra.command_line import UsageError
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from foresee.prediction import View
from planner.risk.calibration import Calibration, CalibrationError
from predictor.registry import load_predictor

SETTINGS = Settings(world=("corridor", "narrow"), predictor="none")
CALIBRATION = Calibration(
    Path("c.json"),
    conditions_for(SETTINGS),
    {0.02: 0.001, 0.05: 0.01},
    0.9,
    seed=7,
    drives=300,
)


def test_the_series_have_names_of_their_own_and_the_levels_of_the_calibration():
    all_series = list_series(CALIBRATION, [], "none", ["maps/a.yaml"], quick=False)
    names = [series.name for series in all_series]
    assert len(set(names)) == len(names)
    asked = {
        series.risk: series.settings.level for series in all_series if series.group == "promise"
    }
    assert asked == {None: 0.0, 0.0: 0.0, 0.02: 0.001, 0.05: 0.01}
    assert all(
        series.settings.fixed_level == ("not adapted" in series.group) for series in all_series
    )
    assert {series.settings.level for series in all_series if "sham" in series.group} == {0.001}
    assert any(series.settings.world == ("maps/a.yaml",) for series in all_series)
    quick = list_series(CALIBRATION, [], "none", [], quick=True)
    assert {series.settings.episodes for series in quick} == {4}


def test_series_are_compared_with_those_that_drive_the_same_tasks():
    all_series = list_series(CALIBRATION, [], "none", [], quick=False)
    same = {}
    for series in all_series:
        same.setdefault((series.group, series.tasks), []).append(series)
    arms = {kind: sorted(series.arm for series in of) for kind, of in same.items()}
    # `predicted` at a risk of 0, and at two others.
    assert arms["promise", "mixture"] == ["known", "optimistic", "oracle", *["predicted"] * 3]
    assert arms["published settings", "maze"] == ["full", "known", "predicted", "predicted"]
    for of in same.values():
        other = {"arms": ("known",), "level": 0.0, "predictor": "none", "episodes": 1}
        assert len({replace(series.settings, **other) for series in of}) == 1


def test_a_calibration_for_another_predictor_is_refused():
    with pytest.raises(CalibrationError, match="is for predictor none, not extend"):
        list_series(CALIBRATION, [], "extend", [], quick=False)


def test_a_calibration_of_another_planner_is_refused_even_if_it_certifies_nothing():
    conditions = CALIBRATION.conditions | {"planner": "other"}
    with pytest.raises(CalibrationError, match="is for planner other"):
        list_series(
            replace(CALIBRATION, conditions=conditions, levels={}), [], "none", [], quick=False
        )


def test_a_calibration_in_buildings_of_the_study_is_refused():
    with pytest.raises(CalibrationError, match="made in buildings of this study"):
        list_series(replace(CALIBRATION, seed=study.SEED), [], "none", [], quick=False)


def test_a_damaged_calibration_is_refused_in_one_line():
    conditions = {k: v for k, v in CALIBRATION.conditions.items() if k != "v_max"}
    with pytest.raises(CalibrationError, match=r"c.json is no calibration: .*v_max"):
        list_series(replace(CALIBRATION, conditions=conditions), [], "none", [], quick=False)


def test_a_level_that_is_certified_for_two_risks_is_driven_once():
    levels = {0.02: 0.3, 0.05: 0.3}
    all_series = list_series(replace(CALIBRATION, levels=levels), [], "none", [], quick=False)
    promises = [series for series in all_series if series.group == "promise"]
    assert {series.risk for series in promises if series.settings.level == 0.3} == {0.02}


def test_maps_of_the_same_name_are_refused():
    with pytest.raises(UsageError, match="a name of its own"):
        list_series(CALIBRATION, [], "none", ["a/map.yaml", "b/map.yaml"], quick=False)


def test_a_fixed_level_is_studied_as_it_was_calibrated():
    fixed = replace(CALIBRATION, conditions=conditions_for(replace(SETTINGS, fixed_level=True)))
    assert all(
        series.settings.fixed_level for series in list_series(fixed, [], "none", [], quick=False)
    )


@pytest.mark.parametrize(
    ("change", "broken"),
    [
        ({}, False),
        ({"interval": [0.06, 0.2]}, True),
        ({"interval": None}, False),
        ({"interval": [0.06, 0.2], "tasks": "trap"}, False),
        ({"interval": [0.06, 0.2], "certified": False}, False),
        ({"interval": [0.06, 0.2], "certified": False, "group": study.OWN}, True),
        ({"requested": 0.0, "collided": 0}, False),
        ({"requested": 0.0}, True),
        ({"requested": 0.0, "collided": 0, "touched": 1}, True),
        ({"requested": None, "certified": False}, False),
    ],
)
def test_a_broken_promise_is_noticed(change, broken):
    row = {"group": "promise", "tasks": "mixture", "arm": "predicted", "requested": 0.05}
    row |= {"certified": True}
    row |= {"collided": 1, "touched": 0, "interval": [0.04, 0.2]}
    assert exceeds_its_risk(row | change) == broken


def test_buildings_of_the_study_are_not_those_of_the_calibration():
    seeds = {
        series.settings.seed for series in list_series(CALIBRATION, [], "none", [], quick=False)
    }
    assert seeds == {study.SEED, study.OTHER_SEED}
    assert min(seeds) > 5_000_000 + 100_000


def test_the_sham_is_sure_of_all_that_it_has_not_seen():
    sham = load_predictor(study.SHAM)
    assert check_predictor(sham) == ()
    cells = np.full((200, 200), UNKNOWN, np.int8)
    cells[80:120, :120], cells[79, :120] = FREE, OCCUPIED
    known = Grid(GridFrame(0.05, (0.0, 0.0), cells.shape), cells)
    answer = sham.predict(View(known, np.array([5.0, 5.0, 0.0])))
    unseen = known.unknown
    assert (answer.p_free[~unseen] == known.free[~unseen]).all()
    trust = answer.confidence[unseen] * answer.p_free[unseen]
    # Enough for the levels that are certified, but not certain.
    assert (trust == trust[0]).all()
    assert 0.99 < trust[0] < 0.9999


@pytest.fixture
def few_series(short_map, monkeypatch):
    """A study of few drives on a short map."""
    base = Settings(world=(str(short_map),), predictor="none", episodes=2, route="fixed")

    def few(calibration, others, predictor, maps, quick):
        found = [
            Series("promise", "mixture", arm, replace(base, arms=(arm,)), 0.0)
            for arm in ("known", "oracle")
        ]
        found.append(
            Series("promise", "mixture", "optimistic", replace(base, arms=("optimistic",)))
        )
        # The last two share their drives.
        for wanted, level in ((0.0, 0.0), (0.05, 0.01), (0.1, 0.01)):
            settings = replace(base, arms=("predicted",), level=level)
            found.append(Series("promise", "mixture", f"{wanted:g}", settings, wanted))
        return found

    monkeypatch.setattr(study, "list_series", few)


@pytest.mark.slow
def test_the_study_drives_says_what_is_missing_and_goes_on(few_series, tmp_path, capsys):
    out = tmp_path / "run"
    command = ["--calibration", str(written(tmp_path / "c.json")), "--jobs", "1", "--out", str(out)]
    assert risk.main([*command, "--hours", "0"]) == 0
    assert "10 drives are still to be made" in capsys.readouterr().out
    assert risk.main(command) == 0
    told = capsys.readouterr().out
    assert "still to be made" not in told
    assert (out / "promise.png").stat().st_size > 5000
    assert (out / "pareto.png").stat().st_size > 5000
    before = {path: path.read_bytes() for path in (out / "drives").iterdir()}
    assert len(before) == 5
    assert risk.main(command) == 0
    assert {path: path.read_bytes() for path in (out / "drives").iterdir()} == before
    capsys.readouterr()
    assert tables.main([str(out / "results.json")]) == 0
    shown = capsys.readouterr().out
    assert "0 of 2" in shown
    assert "| mixture-0.05 " in shown
    assert "| mixture-0.1 " in shown


def test_saved_runs_are_tested_too(few_series, short_map, tmp_path, capsys):
    saved = tmp_path / "saved"
    words = ["--world", str(short_map), "--route", "fixed", "--predictor", "none", "--jobs", "1"]
    words += ["--arms", "known,optimistic", "--episodes", "2"]
    assert corridor.main([*words, "--out", str(saved)]) == 0
    command = ["--calibration", str(written(tmp_path / "c.json")), "--hours", "0", "--jobs", "1"]
    command += ["--out", str(tmp_path / "run"), "--runs", str(saved)]
    assert risk.main(command) == 0
    rows = json.loads((tmp_path / "run/results.json").read_text())["promise"]
    mine = [(r["arm"], r["requested"], r["drives"], r["touched"]) for r in rows]
    assert mine == [("known", 0.0, 2, 0), ("optimistic", None, 2, 0)]
    capsys.readouterr()
    assert risk.main([*command, str(saved)]) == 2
    assert "a name of its own" in capsys.readouterr().err
    results = saved / "results.json"
    told = json.loads(results.read_text())
    told["settings"]["noise"] = 0.02
    results.write_text(json.dumps(told))
    all_series, _ = saved_drives([saved])
    assert [series.risk for series in all_series] == [None, None]
    told["settings"]["level"] = 0.1
    results.write_text(json.dumps(told))
    assert risk.main(command) == 2
    assert "was not driven at a risk of 0" in capsys.readouterr().err


def test_every_rate_of_collisions_is_inside_its_panel():
    folder = Path(__file__).parents[3] / "docs/results"
    figure = _promise(json.loads((folder / "risk.json").read_text()))
    assert figure is not None
    for axes in figure.axes:
        left, right = axes.get_xlim()
        marks = [line.get_xdata()[0] for line in axes.lines if line.get_marker() == "o"]
        assert all(left < mark < right for mark in marks)


def test_times_are_compared_in_each_family():
    series = Series(
        "promise", "mixture", "0.05", replace(SETTINGS, route="fixed", arms=("predicted",))
    )
    speeds = {"known": 1.0, "predicted": 1.25, "oracle": 2.0}
    arms = {
        arm: [a_result(index=i, arm=arm, world=str(i), time=(20.0 + i) / speed) for i in range(40)]
        for arm, speed in speeds.items()
    }
    times = _times_by_family(series, arms)
    assert set(times) == {"corridor", "narrow"}
    for of in times.values():
        assert of["time_ratio"]["value"] == pytest.approx(0.8)
    assert _times_by_family(replace(series, settings=SETTINGS), arms) == {}


def test_a_further_calibration_is_tested_in_buildings_like_its_own():
    alone = replace(SETTINGS, world=("narrow",))
    other = Calibration(Path("n.json"), conditions_for(alone), {0.02: 0.3}, 0.9, seed=900, drives=9)
    all_series = list_series(CALIBRATION, [other], "none", [], quick=False)
    own = [series for series in all_series if series.group == study.OWN]
    assert {series.label for series in own} == {"narrow-0.02", "narrow-known", "narrow-oracle"}
    assert {series.settings.world for series in own} == {("narrow",)}
    assert {series.settings.level for series in own if series.arm == "predicted"} == {0.3}


def test_a_further_calibration_must_not_be_made_in_buildings_of_the_study():
    used = replace(CALIBRATION, path=Path("u.json"), seed=study.OWN_SEED)
    with pytest.raises(CalibrationError, match=r"u.json was made in buildings of this study"):
        list_series(CALIBRATION, [used], "none", [], quick=False)


def test_a_calibration_given_twice_is_refused():
    with pytest.raises(UsageError, match="each calibration, must have a name of its own"):
        list_series(CALIBRATION, [CALIBRATION, CALIBRATION], "none", [], quick=False)


def test_further_calibrations_are_pooled_at_each_risk():
    settings = replace(SETTINGS, route="fixed", arms=("predicted",))
    all_series, drives = [], {}
    for place, collided in (("corridor", 0), ("narrow", 1)):
        here = replace(settings, world=(place,))
        for variant, arm, time in (
            ("0.02", "predicted", 8.0),
            ("known", "known", 10.0),
            ("oracle", "oracle", 5.0),
        ):
            of = replace(here, arms=(arm,), level=0.1 if arm == "predicted" else 0.0)
            series = Series(study.OWN, place, variant, of, 0.02 if arm == "predicted" else 0.0)
            all_series.append(series)
            hit = collided if arm == "predicted" else 0
            drives[series.name] = [
                asdict(
                    a_result(
                        index=i,
                        arm=arm,
                        world=f"{place}{i}",
                        time=time * (1.0 + 0.1 * i),
                        outcome="collided" if i < hit else "reached",
                    )
                )
                for i in range(15)
            ]
    (row,) = pooled_rows(all_series, drives)
    assert (row["requested"], row["collided"], row["drives"]) == (0.02, 1, 30)
    assert row["levels"] == {"corridor": 0.1, "narrow": 0.1}
    assert row["time_ratio"]["value"] == pytest.approx(0.8)


def test_collisions_are_counted_in_each_family():
    series = Series("promise", "mixture", "0.05", replace(SETTINGS, arms=("predicted",)), 0.05)
    outcomes = ["reached", "collided", "collided", "collided", "reached"]
    drives = [{"index": i, "outcome": one} for i, one in enumerate(outcomes)]
    assert _by_family(series, drives) == {"corridor": [1, 3], "narrow": [2, 2]}
    on_maps = replace(series, settings=replace(series.settings, world=("maps/a.yaml",)))
    assert _by_family(on_maps, drives) == {}


def test_a_collision_at_no_risk_is_an_exit_status_of_one(few_series, tmp_path, monkeypatch):
    from benchmarks.studies.risk import drives

    monkeypatch.setattr(drives, "touches", lambda *_: True)
    command = ["--calibration", str(written(tmp_path / "c.json")), "--jobs", "1"]
    assert risk.main([*command, "--out", str(tmp_path / "run")]) == 1


def test_drives_in_few_maps_say_nothing_of_the_rate_in_others():
    series = Series("promise", "maps", "0.05", replace(SETTINGS, arms=("predicted",)), 0.05)
    drives = [
        asdict(a_result(index=i, outcome="collided" if i % 9 == 0 else "reached"))
        | {"touched": False}
        for i in range(60)
    ]
    spread = {60: lambda i: i, 30: lambda i: i // 2, 3: lambda i: i // 20}
    widths = {}
    for worlds, of in spread.items():
        driven = [drive | {"world": f"map {of(i)}"} for i, drive in enumerate(drives)]
        (row,) = collision_rows([series], {series.name: driven}, {})
        assert (row["drives"], row["worlds"], row["collided"]) == (60, worlds, 7)
        for name in ("interval", "per_km_interval"):
            widths[worlds, name] = row[name] and row[name][1] - row[name][0]
    for name in ("interval", "per_km_interval"):
        assert widths[3, name] is None
        assert widths[30, name] > 1.2 * widths[60, name]


@pytest.mark.parametrize("revision", [1, 2])
def test_drives_at_a_level_of_an_earlier_planner_are_marked(revision):
    calibration = replace(CALIBRATION, revision=revision)
    all_series = list_series(calibration, [], "none", [], quick=True)
    drive = asdict(a_result(revision=2)) | {"touched": False}
    rows = collision_rows(all_series, {series.name: [drive] for series in all_series}, {})
    marked = {row["earlier_calibration"] for row in rows if row["level"] > 0.0}
    assert marked == {revision < 2}
    assert not any(row["earlier_calibration"] for row in rows if row["level"] == 0.0)
    assert (EARLIER in _collision_table(rows)) is (revision < 2)
