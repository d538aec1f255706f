"""Repeated calibrations on the drives of the risk study."""

from dataclasses import replace

import pytest

from benchmarks.runs.settings import Settings
from benchmarks.studies.risk.figures import draw
from benchmarks.studies.risk.recalibration import BLOCK, recalibrations
from benchmarks.studies.risk.series import Series
from benchmarks.studies.risk.tables import tables as tables_of

SETTINGS = Settings(world=("corridor", "narrow"), predictor="none")


@pytest.fixture
def levels():
    """Series of the mixture at three levels."""
    predicted = replace(SETTINGS, arms=("predicted",))
    return [
        Series("promise", "mixture", f"{risk:g}", replace(predicted, level=level))
        for level, risk in {0.003: 0.01, 0.01: 0.02, 0.03: 0.05}.items()
    ]


def drives_with(all_series, *collided, count=2 * BLOCK):
    """Drives of each series: those with the given indices collide."""
    return {
        series.name: [
            {"index": i, "outcome": "collided" if i in those else "reached"} for i in range(count)
        ]
        for series, those in zip(all_series, collided, strict=True)
    }


def test_a_block_without_collisions_certifies_the_boldest_level(levels):
    rows = recalibrations(levels, drives_with(levels, (), (), (BLOCK,)), "none", 0.9)
    first = [(r["requested"], r["level"], r["collided"], r["drives"]) for r in rows[:3]]
    assert first == [(risk, 0.03, 1, BLOCK) for risk in (0.05, 0.1, 0.2)]
    # The collision is in the second block: it certifies less, and is judged in the first.
    assert (rows[3]["level"], rows[3]["collided"]) == (0.01, 0)
    assert rows[5]["level"] == 0.03


def test_the_first_level_that_is_not_certified_ends_a_calibration(levels):
    often = range(0, BLOCK, 2)
    rows = recalibrations(levels, drives_with(levels, (), often, ()), "none", 0.9)
    assert {r["level"] for r in rows if r["block"] == 0} == {0.003}
    assert {r["level"] for r in rows if r["block"] == 1} == {0.03}
    rows = recalibrations(levels, drives_with(levels, often, (), ()), "none", 0.9)
    assert rows[0]["level"] == 0.0
    assert rows[0]["rate"] is None


def test_a_test_that_was_given_up_is_not_revived(levels):
    # As in a calibration, which would have stopped after the third collision.
    rows = recalibrations(levels, drives_with(levels, (), range(3), ()), "none", 0.9)
    assert {r["level"] for r in rows if r["block"] == 0} == {0.003}


def test_only_whole_blocks_of_the_calibrated_predictor_are_used(levels):
    assert recalibrations(levels, drives_with(levels, (), (), (), count=70), "none", 0.9) == []
    assert recalibrations(levels, drives_with(levels, (), (), ()), "extend", 0.9) == []


def test_repeated_calibrations_are_shown(levels, tmp_path):
    rows = recalibrations(levels, drives_with(levels, (), (), (BLOCK,)), "none", 0.9)
    found = {"promise": [], "pareto": [], "pooled": [], "missing": 0, "recalibrations": rows}
    assert f"1 of {BLOCK}" in tables_of(found)
    assert [path.name for path in draw(found, tmp_path)] == ["recalibrations.png"]
