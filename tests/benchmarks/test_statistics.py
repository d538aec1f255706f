"""Intervals and tests against known values, and the laws of paired comparison."""

import math
from dataclasses import replace

import numpy as np
import pytest
from drive_results import a_result
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.runs.statistics import (
    independent,
    mcnemar,
    mean_speed,
    promises_broken,
    rate_interval,
    share_of_gap,
    success,
    time_ratio,
    wilson,
)
from foresee.statistics import MIN_GROUPS

OUTCOMES = ("reached", "collided", "timed_out", "stuck")
WORLDS = MIN_GROUPS + 4
"""Number of worlds in which drives are compared, enough for intervals."""


def result(world="w", length=10.0, time=5.0, outcome="reached", broken=0, promises=0):
    return a_result(
        world=world,
        path_length=length,
        time=time,
        outcome=outcome,
        promises_broken=broken,
        promises=promises,
    )


def drives(lengths, time=10.0):
    return [result(f"w{i}", length, time) for i, length in enumerate(lengths)]


def scored(scts, times=None):
    """A drive in each of as many worlds."""
    times = times or [10.0] * len(scts)
    return [
        replace(result(f"w{i}", time=time), sct=sct)
        for i, (sct, time) in enumerate(zip(scts, times, strict=True))
    ]


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [
        (0, 10, 0.0, 0.277533),
        (5, 10, 0.236593, 0.763407),
        (1, 20, 0.008881, 0.236131),
        (0, 100, 0.0, 0.036994),
        (97, 100, 0.915480, 0.989746),
    ],
)
def test_wilson_intervals_are_those_of_the_formula(successes, trials, low, high):
    assert wilson(successes, trials) == pytest.approx((low, high), abs=2e-6)


@given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_intervals_hold_the_share_and_mirror(counts):
    k, n = counts
    z = 1.959963984540054
    middle = (k + z**2 / 2) / (n + z**2)
    half = z / (n + z**2) * math.sqrt(k * (n - k) / n + z**2 / 4)
    low, high = wilson(k, n)
    assert (low, high) == pytest.approx((max(0, middle - half), min(1, middle + half)), abs=1e-9)
    assert low - 1e-12 <= k / n <= high + 1e-12
    assert wilson(n - k, n) == pytest.approx((1 - high, 1 - low), abs=1e-12)


def test_each_drive_counts_where_it_has_a_world_of_its_own():
    worlds = [f"w{i}" for i in range(100)]
    assert rate_interval([False] * 100, worlds) == pytest.approx(wilson(0, 100))
    assert rate_interval([True] * 3 + [False] * 97, worlds) == pytest.approx(wilson(3, 100))


def test_three_drives_in_each_map_count_as_one():
    maps = [f"map {i // 3}" for i in range(99)]
    assert independent(maps) == 33
    assert rate_interval([False] * 99, maps) == pytest.approx(wilson(0, 33))
    collided = [i in (0, 1, 2) for i in range(99)]
    assert rate_interval(collided, maps) == pytest.approx(wilson(1, 33))
    assert independent(["a", "a", "a", "b"]) == 1.6


def test_intervals_of_collisions_hold_even_if_the_drives_in_a_map_go_alike():
    rng, held = np.random.default_rng(0), {"maps": 0, "drives": 0}
    for _ in range(1000):
        # In a tenth of the maps nearly all drives collide, in the others hardly any.
        risky = np.repeat(rng.random(33) < 0.1, 3)
        collided = rng.random(99) < np.where(risky, 0.9, 0.01)
        low, high = rate_interval(collided, [f"map {i // 3}" for i in range(99)])
        held["maps"] += low <= 0.099 <= high
        low, high = wilson(int(collided.sum()), 99)
        held["drives"] += low <= 0.099 <= high
    assert held["maps"] >= 930
    assert held["drives"] < 850


def test_the_speed_of_an_arm_is_all_length_over_all_time():
    results = [result(length=10, time=10), result(length=30, time=10)]
    assert mean_speed({"a": results}, "a")["value"] == pytest.approx(2.0)


def test_a_speed_that_is_the_same_everywhere_has_no_interval():
    entry = mean_speed({"a": drives([20.0] * 29)}, "a")
    assert entry == {"value": pytest.approx(2.0), "low": None, "high": None, "groups": 29}


def test_a_difference_changes_sign_with_its_order():
    rng = np.random.default_rng(0)
    arms = {"a": drives(rng.uniform(20, 30, 32)), "b": drives(rng.uniform(10, 22, 32))}
    one, other = mean_speed(arms, "a", "b"), mean_speed(arms, "b", "a")
    assert one["value"] == pytest.approx(-other["value"])
    assert one["low"] == pytest.approx(-other["high"])
    assert mean_speed(arms, "a", "a")["value"] == 0.0


def test_one_world_driven_twice_gives_no_interval():
    known, predicted, oracle = (
        [result("map", length) for _ in range(2)] for length in (20, 23, 25)
    )
    arms = {"known": known, "predicted": predicted, "oracle": oracle}
    faster = mean_speed(arms, "predicted", "known")
    assert faster["value"] == pytest.approx(0.6)
    assert (faster["low"], faster["high"]) == (None, None)


@pytest.mark.parametrize("worlds", [1, 5, 19, 20, 25])
def test_an_interval_takes_twenty_distinct_worlds(worlds):
    rng = np.random.default_rng(0)
    # Two drives in each world, and no two worlds alike.
    names = 2 * [f"w{i}" for i in range(worlds)]
    arms = {
        name: [
            replace(
                result(world, promises=9, broken=1 + i % 3, time=time * rng.uniform(0.9, 1.1)),
                sct=sct * rng.uniform(0.9, 1.1),
            )
            for i, world in enumerate(names)
        ]
        for name, sct, time in (
            ("known", 0.3, 9),
            ("backup", 0.3, 9),
            ("predicted", 0.4, 7),
            ("oracle", 0.5, 6),
        )
    }
    given = [
        mean_speed(arms, "known"),
        mean_speed(arms, "oracle", "known"),
        success(arms, "oracle"),
        time_ratio(arms, "predicted", "known"),
        promises_broken(arms["known"]),
    ]
    enough = worlds >= MIN_GROUPS == 20
    for figure in given:
        assert (figure["low"] is not None, figure["high"] is not None) == (enough, enough)
    for share in shares(arms):
        assert (share is not None) == enough
    assert (rate_interval([False] * len(names), names) is not None) == enough


def test_the_sct_of_an_arm_is_the_mean_over_all_its_episodes():
    found = success({"a": scored([0.9, 0.5, 0.0, 0.4, 0.2] * 5)}, "a")
    assert found["value"] == pytest.approx(0.4)
    assert 0.0 < found["low"] < 0.4 < found["high"] < 0.9


def test_an_episode_without_an_sct_in_one_arm_counts_in_none():
    arms = {"known": scored([0.5] * 6), "oracle": scored([0.7] * 5 + [None])}
    assert success(arms, "known")["value"] == pytest.approx(0.5)
    arms["known"][5] = replace(arms["known"][5], sct=0.0)
    assert success(arms, "known")["value"] == pytest.approx(0.5)
    older = {"known": drives([20] * 6)}
    assert success(older, "known") is None


def test_the_time_ratio_is_of_the_episodes_that_both_reached():
    known = scored([0.5] * 6, [10, 20, 30, 10, 10, 99])
    arm = scored([0.5] * 6, [8, 16, 24, 8, 8, 1])
    known[5] = replace(known[5], outcome="stuck")
    arms = {"known": known, "arm": arm}
    found = time_ratio(arms, "arm", "known")
    assert (found["value"], found["episodes"]) == (pytest.approx(0.8), 5)
    arm[0] = replace(arm[0], outcome="collided")
    assert time_ratio(arms, "arm", "known")["episodes"] == 4
    assert time_ratio({"known": known, "arm": [known[5]] * 6}, "arm", "known") is None


@given(st.lists(st.tuples(st.floats(1, 100), st.floats(1, 100)), min_size=1, max_size=30))
def test_time_ratios_one_way_and_the_other_are_reciprocal(times):
    arms = {
        name: scored([0.5] * len(times), [pair[i] for pair in times]) for i, name in enumerate("ab")
    }
    there, back = time_ratio(arms, "a", "b"), time_ratio(arms, "b", "a")
    assert there["value"] * back["value"] == pytest.approx(1.0)
    if there["low"] is not None:
        assert there["low"] * back["high"] == pytest.approx(1.0)
    assert time_ratio(arms, "a", "a")["value"] == 1.0


def paired_drives(**drives):
    """Arms with a drive, (SCT, time), in each of some worlds of different lengths."""
    sizes = np.linspace(0.8, 1.2, WORLDS)
    return {
        arm: scored((sct * sizes).tolist(), (time * sizes).tolist())
        for arm, (sct, time) in drives.items()
    }


def shares(arms, arm="predicted"):
    return [share_of_gap(arms, arm, key) for key in ("sct", "time")]


@pytest.mark.parametrize("where", [0.0, 0.5, 1.0, -0.2])
def test_the_share_of_the_gap_is_where_an_arm_stands_between_the_best_baseline_and_oracle(where):
    ends = {"known": (0.3, 20.0), "backup": (0.4, 16.0), "oracle": (0.6, 12.0)}
    arms = paired_drives(**ends, predicted=(0.4 + 0.2 * where, 16.0 - 4.0 * where))
    # Where `known` is the better baseline, it takes the place of `backup`.
    swapped = arms | {"known": arms["backup"], "backup": arms["known"]}
    for compared, baseline in ((arms, "backup"), (swapped, "known")):
        for share in shares(compared):
            assert share["baseline"] == baseline
            assert share["value"] == pytest.approx(where)


def test_the_share_of_the_gap_lies_in_its_interval():
    rng = np.random.default_rng(0)
    arms = {
        name: scored(rng.normal(sct, 0.05, 25).tolist(), rng.normal(time, 2.0, 25).tolist())
        for name, sct, time in (
            ("known", 0.2, 24),
            ("backup", 0.3, 20),
            ("predicted", 0.4, 16),
            ("oracle", 0.7, 12),
        )
    }
    for found, share in zip(shares(arms), (0.25, 0.5), strict=True):
        assert found["low"] < share < found["high"]
        assert found["high"] - found["low"] < 0.5


def test_a_share_against_known_alone_is_not_given():
    arms = paired_drives(known=(0.3, 20.0), predicted=(0.5, 15.0), oracle=(0.6, 12.0))
    assert shares(arms) == [None, None]


def test_speed_bought_by_a_detour_closes_no_gap():
    # Twice the way at twice the speed: as late as `known`.
    arms = paired_drives(known=(0.4, 10.0), backup=(0.4, 10.0), oracle=(0.8, 10.0))
    arms["predicted"] = [replace(d, path_length=2 * d.path_length) for d in arms["known"]]
    assert mean_speed(arms, "predicted", "known")["value"] == pytest.approx(1.0)
    assert share_of_gap(arms, "predicted", "sct")["value"] == 0.0


def test_a_drive_that_did_not_arrive_counts_in_sct_and_not_in_time():
    ends = {"known": (0.4, 20), "backup": (0.4, 20), "oracle": (0.8, 10)}
    arms = paired_drives(**ends, predicted=(0.5, 16))
    before = shares(arms)
    arms["predicted"][0] = replace(arms["predicted"][0], sct=0.0, outcome="stuck", time=40.0)
    after = shares(arms)
    assert after[0]["value"] < before[0]["value"]
    assert after[1]["value"] == pytest.approx(before[1]["value"])


def test_no_share_is_given_where_the_oracle_is_not_better_with_certainty():
    rng = np.random.default_rng(0)
    scts, times = rng.uniform(0.4, 0.6, (2, WORLDS)), rng.uniform(18, 22, (2, WORLDS))
    known, oracle = (scored(list(s), list(t)) for s, t in zip(scts, times, strict=True))
    better = scored([0.9] * WORLDS, [10] * WORLDS)
    same = {"known": known, "backup": known, "predicted": known}
    assert shares(same | {"oracle": oracle}) == [None, None]
    assert shares(same | {"backup": better, "oracle": known}) == [None, None]
    assert None not in shares(same | {"oracle": better})
    assert share_of_gap({name: drives([20] * WORLDS) for name in same}, "predicted", "sct") is None


@given(st.lists(st.tuples(st.sampled_from(OUTCOMES), st.sampled_from(OUTCOMES)), max_size=30))
def test_mcnemars_test_is_symmetric_and_a_probability(pairs):
    first, second = ([result(outcome=pair[i]) for pair in pairs] for i in (0, 1))
    p = mcnemar(first, second, "collided")
    assert p == pytest.approx(mcnemar(second, first, "collided"))
    assert 0.0 <= p <= 1.0
    assert mcnemar(first, first, "collided") == 1.0


def test_mcnemars_test_counts_discordant_pairs_alone():
    def of(*outcomes):
        return [result(f"w{i}", outcome=outcome) for i, outcome in enumerate(outcomes)]

    bad, good = "collided", "reached"
    most = mcnemar(of(*[bad] * 6, *[good] * 9), of(*[good] * 15), bad)
    assert most == pytest.approx(2 * 0.5**6)
    assert mcnemar(of(*[bad] * 6), of(*[good] * 6), bad) == pytest.approx(2 * 0.5**6)
    assert mcnemar(of(*[bad] * 3, *[good] * 3), of(*[good] * 3, *[bad] * 3), bad) == 1.0


def test_mcnemars_test_counts_the_drives_in_one_world_once():
    bad, good = result(outcome="collided"), result()
    assert mcnemar([bad] * 6, [good] * 6, "collided") == 1.0


def test_the_share_of_broken_promises_is_the_mean_over_worlds_not_over_ticks():
    results = [
        result("a", broken=5, promises=10),
        *(result(w, promises=98) for w in "bcde"),
        result("f", promises=0),
    ]
    assert promises_broken(results)["value"] == pytest.approx(0.1)
    many = promises_broken([replace(r, world=f"{r.world}{i}") for r in results for i in range(5)])
    assert 0.0 <= many["low"] < 0.1 < many["high"]
    assert promises_broken([result("a")]) is None


def test_the_interval_of_an_sct_is_over_buildings_not_over_episodes():
    # Ten episodes in each building, all alike: they say no more than one.
    many = [replace(result(f"w{i}"), sct=float(i % 2)) for i in range(24) for _ in range(10)]
    few = scored([float(i % 2) for i in range(24)])
    assert success({"a": many}, "a") == pytest.approx(success({"a": few}, "a"))
