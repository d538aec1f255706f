"""The summary of a comparison in a few rows and in words."""

import re

import pytest
from drive_results import a_result

from benchmarks.runs.summary import gap, summarise
from benchmarks.runs.summary_text import in_words, main_table, table

ARMS = ("known", "backup", "predicted 2 %")


def drives_of(worlds, jitter=0.0, **changes):
    """Drives in which `backup` takes .8 and an arm at a risk .6 of the time."""
    return [
        a_result(
            index=i,
            world=f"w{i}",
            arm=arm,
            time=time + jitter * (i * time % 3),
            level=0.1,
            **changes.get(arm, {}),
        )
        for arm, time in zip(ARMS, (10.0, 8.0, 6.0), strict=True)
        for i in range(worlds)
    ]


def summary_of(worlds, **changes):
    """The summary of these drives."""
    return summarise(drives_of(worlds, **changes), ARMS)


def words_of(worlds, **changes):
    """What is said of these drives."""
    return in_words(summary_of(worlds, **changes), drives_of(worlds, **changes))


def test_words_say_what_each_driver_takes_and_who_collided():
    assert words_of(4) == (
        "Times, where that of `known`, which plans within what it observed, is 1: "
        "`backup` (no network) 0.80, `predicted 2 %` 0.60. These are too few buildings for "
        "intervals. No drive collided."
    )
    many = words_of(30, jitter=0.5)
    assert re.search(r"`backup` \(no network\) 0\.8\d \(0\.\d\d–0\.\d\d\),", many)
    assert "too few" not in many
    # All buildings agree: there is no interval, but not for want of buildings.
    assert "too few" not in words_of(30)
    crashed = words_of(4, **{"predicted 2 %": {"outcome": "collided"}})
    assert crashed.endswith("`predicted 2 %` collided in 4 of 4 drives.")
    assert in_words({}, []) == ""


def test_a_collision_in_an_episode_that_another_arm_has_not_driven_is_told():
    alone = a_result(arm="backup", index=9, outcome="collided")
    said = in_words(summary_of(4), [*drives_of(4), alone])
    assert said.endswith("`backup` collided in 1 of 5 drives.")


def test_the_main_rows_are_few_and_those_of_the_whole_table():
    summary = summary_of(4)
    few, whole = (
        [[cell.strip() for cell in line.split("|")] for line in text.splitlines()[2:] if line]
        for text in (main_table(summary), table(summary, {}))
    )
    assert len(few) == 8
    assert all(row in whole for row in few)
    assert {"hard stops", "collided (95 % over worlds)"} <= {row[1] for row in few}


@pytest.mark.parametrize(
    ("arm", "level", "closes"),
    [("predicted", 0.0, True), ("predicted", 0.1, False), ("predicted 2 %", 0.1, False)],
)
def test_no_share_of_the_gap_is_given_at_a_risk_that_no_baseline_takes(arm, level, closes):
    times = {"known": 10.0, "backup": 9.0, arm: 8.0, "oracle": 7.0}
    episodes = [
        a_result(
            index=i,
            world=f"w{i}",
            arm=name,
            time=time * (1.0 + 0.01 * i),
            level=level if name == arm else None,
        )
        for name, time in times.items()
        for i in range(30)
    ]
    share = gap(episodes, tuple(times), "fixed")[arm]["time"]
    assert share is None if not closes else share["value"] == pytest.approx(0.5)


@pytest.mark.parametrize(("counts", "shown"), [((1, 2), "3"), ((1, None), "")])
def test_hard_stops_are_counted_only_if_all_drives_know_theirs(counts, shown):
    episodes = [
        a_result(index=i, world=f"w{i}", hard_stops=count) for i, count in enumerate(counts)
    ]
    lines = main_table(summarise(episodes, ("known",))).splitlines()
    row = next(line for line in lines if "hard stops" in line)
    assert row.split("|")[2].strip() == shown


def test_the_head_of_a_column_says_whether_its_risk_is_certified():
    for changes, head in (
        ({"uncertified": True, "calibrated": 1, "revision": 2}, "`predicted 2 %`, not certified"),
        ({"calibrated": 1, "revision": 2}, "`predicted 2 %`, calibrated with an earlier planner"),
        ({"calibrated": 2, "revision": 2}, "`predicted 2 %` "),
    ):
        text = table(summary_of(2, **{"predicted 2 %": changes}), {})
        assert f"| {head}" in text
        assert "`predicted 2 %` drives at level 0.1." in text
