"""Drives on the wall clock say how many controls and predictions were late."""

import dataclasses

import pytest
from short_drive import straight

from benchmarks.runs.drive import drive
from benchmarks.runs.settings import Settings
from benchmarks.runs.summary import summarise
from benchmarks.runs.summary_text import main_table, title
from benchmarks.runs.warm_up import warm_up_if_cold


@pytest.mark.slow(20)
def test_a_drive_on_the_wall_clock_counts_what_was_late_and_does_not_collide():
    warm_up_if_cold()
    settings = Settings(arms=("predicted",), predictor="extend", real_time=True)
    result = drive(settings, 0, "predicted", straight()).result
    assert result.outcome != "collided"
    assert result.late_ticks == result.faults.get("missed_tick", 0)
    assert result.late_predictions == result.faults.get("predictor_late", 0)
    late = dataclasses.replace(result, late_ticks=3, late_predictions=1)
    table = main_table(summarise([late], ("predicted",)))
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines()]
    assert ["late controls / ticks", f"3 / {late.ticks}"] in rows
    assert ["late predictions / ticks", f"1 / {late.ticks}"] in rows
    assert "on the wall clock" in title(dataclasses.asdict(settings))


def test_a_deadline_alone_counts_late_predictions_but_no_controls():
    settings = Settings(arms=("predicted",), predictor="extend", deadline=0.001)
    result = drive(settings, 0, "predicted", straight()).result
    assert result.outcome == "reached"
    assert result.late_ticks is None
    assert result.late_predictions == result.faults.get("predictor_late", 0)
    assert "late controls" not in main_table(summarise([result], ("predicted",)))
