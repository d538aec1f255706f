"""The study of what prediction is worth: its series, its baselines, and what it says."""

from dataclasses import asdict, replace

import pytest
from calibrations import written
from drive_results import a_result

from benchmarks.calibration.certificate import SHIPPED, conditions_for, load_calibration
from benchmarks.runs.settings import Settings
from benchmarks.studies.worth.figures import draw
from benchmarks.studies.worth.report import rows
from benchmarks.studies.worth.series import (
    FREE,
    MIXTURE,
    PRESCRIBED,
    WINDOWS,
    Series,
    list_series,
)
from benchmarks.studies.worth.tables import tables
from predictor.recording.settings import LEARNED

SIGHTS = ((5.0, 4.0), (20.0, 8.0))
SETTINGS = Settings(world=("corridor",), route="fixed", predictor="none", episodes=9)
TIMES = {
    "known": 20.0,
    "backup": 17.0,
    "distance": 18.0,
    "compact": 16.0,
    "distance 2 %": 15.0,
    "compact 2 %": 12.0,
    "oracle": 10.0,
}


def settings_of(driver):
    name, _, risk = driver.partition(" ")
    of = SETTINGS if name in ("known", "backup", "oracle") else replace(SETTINGS, predictor=name)
    arm = name if of is SETTINGS else "predicted"
    return replace(of, arms=(arm,), risk=0.02 if risk else 0.0, level=0.1 if risk else 0.0)


def driven(part=PRESCRIBED, window=5.0, outcomes=None):
    """Series of one group, and their drives, at the times of `TIMES` in each building."""
    group = [
        Series(part, "mixture", driver, replace(settings_of(driver), window=window))
        for driver in TIMES
    ]
    drives = {
        series.name: [
            asdict(
                a_result(
                    index=i,
                    arm=series.arm,
                    world=f"w{i}",
                    time=TIMES[series.driver] + i,
                    sct=0.5,
                    hard_stops=1,
                    outcome=(outcomes or {}).get(series.driver, "reached"),
                )
            )
            for i in range(9)
        ]
        for series in group
    }
    return group, drives


def by_driver(group, drives):
    return {row["driver"]: row for row in rows(group, drives)}


def test_a_driver_is_compared_with_the_best_one_without_a_network_at_no_more_risk():
    found = by_driver(*driven())
    assert {name: row["baseline"] for name, row in found.items()} == {
        "known": None,
        "backup": None,
        "distance": None,
        "compact": "backup",
        "distance 2 %": None,
        "compact 2 %": "distance 2 %",
        "oracle": "backup",
    }
    sums = {driver: sum(time + i for i in range(9)) for driver, time in TIMES.items()}
    assert found["compact 2 %"]["time_over_baseline"]["value"] == pytest.approx(
        sums["compact 2 %"] / sums["distance 2 %"]
    )
    assert found["compact"]["hard_stops"] == 9


def test_collisions_count_though_their_times_do_not():
    found = by_driver(*driven(outcomes={"compact 2 %": "collided"}))
    assert found["compact 2 %"]["drives"][8] == "collided"
    assert found["compact"]["drives"][8] == TIMES["compact"] + 8
    assert found["compact 2 %"]["collided"] == 9
    assert found["compact 2 %"]["time_ratio"] is None
    assert found["compact"]["time_ratio"] is not None


def test_tables_and_figure_show_every_driver(tmp_path):
    groups = [driven(WINDOWS, window) for window in (5.0, 10.0)]
    found = [row for group, drives in groups for row in rows(group, drives)]
    results = {"rows": found, "left_out": ["extend 2 % does not drive"], "missing": 3}
    said = tables(results)
    for driver in TIMES:
        assert said.count(f"| `{driver}`") == 2
    assert "of `distance 2 %`" in said
    assert "extend 2 % does not drive" in said
    assert "3 drives are still to be made" in said
    (figure,) = draw(results, tmp_path)
    assert figure.stat().st_size > 5000
    assert draw({"rows": []}, tmp_path) == []


def test_a_table_gives_the_times_in_each_family_and_names_those_who_are_slower():
    group, drives = driven(WINDOWS)
    mixed = [
        replace(series, settings=replace(series.settings, world=("corridor", "narrow", "office")))
        for series in group
    ]
    for drive in drives[mixed[1].name]:
        drive["time"] *= 2.0 if drive["index"] % 3 == 1 else 1.0
    # A driver that reaches no goal in a family has no time there.
    for drive in drives[mixed[-1].name]:
        drive["outcome"] = "stuck" if drive["index"] % 3 == 2 else "reached"
    found = rows(mixed, drives)
    backup = next(row for row in found if row["driver"] == "backup")
    indices = (1, 4, 7)
    expected = sum(2 * (17 + i) for i in indices) / sum(20 + i for i in indices)
    assert backup["by_family"]["narrow"]["value"] == pytest.approx(expected)
    said = tables({"rows": found, "left_out": [], "missing": 0})
    line = next(line for line in said.splitlines() if line.startswith("Slower than"))
    assert "`backup` in `narrow` (window 5 m, 4 m/s)." in line
    assert line.count(" in `") == 1
    table = [line for line in said.splitlines() if line.startswith("| 5 ")]
    assert [row.split("|")[3].strip() for row in table] == ["corridor", "narrow", "office"]
    assert table[2].split("|")[-2].strip() == ""
    # The table is of a risk of 0, and of mixtures alone.
    assert "2 %" not in said[said.index("in each family") :]
    assert "in each family" not in tables(
        {"rows": rows(*driven(WINDOWS)), "left_out": [], "missing": 0}
    )


def test_the_series_have_names_and_buildings_of_their_own_and_the_same_tasks_in_a_group(short_map):
    parts = (PRESCRIBED, WINDOWS, FREE)
    found, left_out = list_series(
        parts, ("mixture", "trap"), (str(short_map),), ("distance", "compact"), (), 33, SIGHTS
    )
    assert len({series.name for series in found}) == len(found)
    assert {s.group[2:] for s in found if s.part == WINDOWS} == set(SIGHTS)
    free = {series.settings.episodes for series in found if series.part == FREE}
    assert free == {49}
    groups = {}
    for series in found:
        same = replace(
            series.settings,
            arms=("known",),
            predictor="none",
            risk=0.0,
            level=0.0,
            calibrated=1,
            uncertified=False,
        )
        groups.setdefault(series.group, set()).add(same)
    assert {len(same) for same in groups.values()} == {1}
    # There is no calibration of the rule; the network is certified in the mixture alone.
    lines = [line for line in left_out if "does not drive" in line]
    assert lines
    assert all("distance" in line for line in lines)
    certified = {
        series.tasks: not series.settings.uncertified
        for series in found
        if series.part == PRESCRIBED and series.driver == "compact 2 %"
    }
    assert certified == {"mixture": True, "trap": False, "real": False}
    for path in SHIPPED:
        used = load_calibration(path)
        assert not any(used.has_used(s.settings.seed, s.settings.episodes) for s in found)


def test_a_calibration_of_ones_own_lets_a_predictor_drive_at_its_risk(tmp_path):
    settings = Settings(world=MIXTURE, route="fixed", predictor="distance", reliance=0.11)
    path = written(tmp_path / "c.json", conditions=conditions_for(settings))
    found, _ = list_series((PRESCRIBED,), ("mixture",), (), ("distance",), (path,), 4, SIGHTS)
    levels = {s.driver: s.settings.level for s in found if s.settings.risk}
    assert levels == {"distance 2 %": 0.003, "distance 5 %": 0.01}
    # It drives at the reliance at which it was calibrated.
    reliances = {s.driver: s.settings.reliance for s in found if s.driver.startswith("distance")}
    assert reliances == {"distance": Settings.reliance, "distance 2 %": 0.11, "distance 5 %": 0.11}
    assert not any(s.settings.uncertified for s in found)


def test_a_risk_with_the_level_of_a_smaller_one_is_not_driven_again(tmp_path):
    settings = Settings(world=MIXTURE, route="fixed", predictor="distance")
    same = {"0.02": 0.01, "0.05": 0.01}
    path = written(tmp_path / "c.json", conditions=conditions_for(settings), certified=same)
    found, left_out = list_series(
        (PRESCRIBED,), ("mixture",), (), ("distance",), (path,), 4, SIGHTS
    )
    assert [s.driver for s in found if s.settings.risk] == ["distance 2 %"]
    assert left_out == ["prescribed, mixture: distance 5 % has the level of distance 2 %"]


def test_the_mixture_is_that_of_the_learned_families():
    # No certificate holds in as_built, from which networks learn since.
    assert set(MIXTURE) == set(LEARNED) - {"as_built"}
