"""Intervals and tests against known values, and the laws of paired comparison."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.statistics import (
    bootstrap,
    difference,
    mcnemar,
    paired_speed,
    realised_risk,
    share_of_gap,
    wilson,
)

OUTCOMES = ("reached", "collided", "timed_out", "stuck")


def result(world="w", length=10.0, time=5.0, outcome="reached", broken=0, promises=0):
    return {"world": world, "path_length": length, "time": time, "outcome": outcome,
            "promises_broken": broken, "promises": promises}  # fmt: skip


def drives(lengths, time=10.0):
    return [result(f"w{i}", length, time) for i, length in enumerate(lengths)]


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [(0, 10, 0.0, 0.277533), (5, 10, 0.236593, 0.763407), (1, 20, 0.008881, 0.236131),
     (0, 100, 0.0, 0.036994), (97, 100, 0.915480, 0.989746)],
)  # fmt: skip
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


def test_nothing_tried_says_nothing():
    assert wilson(0, 0) == (0.0, 1.0)


def test_the_speed_of_an_arm_is_all_length_over_all_time():
    results = [result(length=10, time=10), result(length=30, time=10)]
    assert paired_speed({"a": results}, "a")["value"] == pytest.approx(2.0)


def test_the_interval_of_a_constant_is_a_point():
    entry = paired_speed({"a": drives([20.0] * 9)}, "a")
    assert entry == pytest.approx({"value": 2.0, "low": 2.0, "high": 2.0})


def test_a_bootstrap_draws_whole_worlds_and_the_same_ones_each_time():
    worlds, seen = ["a", "a", "a", "b"], []
    for _ in range(2):
        bootstrap(worlds, np.eye(4), lambda sums: seen.append(sums) or sums[0], rounds=50)
    counts, again = seen
    assert counts.shape == (4, 50)
    assert (counts[0] == counts[1]).all()
    assert (counts[0] == counts[2]).all()
    assert (counts[0] + counts[3] == 2).all()
    assert set(counts[0]) == {0, 1, 2}
    assert (counts == again).all()


def test_a_difference_changes_sign_with_its_order():
    rng = np.random.default_rng(0)
    arms = {"a": drives(rng.uniform(20, 30, 12)), "b": drives(rng.uniform(10, 22, 12))}
    one, other = difference(arms, "a", "b"), difference(arms, "b", "a")
    assert one["value"] == pytest.approx(-other["value"])
    assert one["low"] == pytest.approx(-other["high"])
    assert difference(arms, "a", "a") == pytest.approx({"value": 0, "low": 0, "high": 0})


@pytest.mark.parametrize(
    ("predicted", "share"), [(20.0, 0.0), (25.0, 0.5), (30.0, 1.0), (18, -0.2)]
)
def test_the_share_of_the_gap_is_where_predicted_stands_between_known_and_oracle(predicted, share):
    lengths = {"known": 20.0, "predicted": predicted, "oracle": 30.0}
    arms = {name: drives([length] * 6) for name, length in lengths.items()}
    entry = share_of_gap(arms)
    assert entry == pytest.approx({"value": share, "low": share, "high": share})


def test_no_share_is_given_where_the_oracle_is_not_faster_with_certainty():
    known = drives([20, 21, 19, 20, 22, 18])
    oracle = drives([21, 19, 20, 23, 18, 19])
    assert difference({"known": known, "oracle": oracle}, "oracle", "known")["low"] <= 0
    assert share_of_gap({"known": known, "predicted": known, "oracle": oracle}) is None
    assert share_of_gap({"known": known, "oracle": drives([40] * 6)}) is None


@given(st.lists(st.tuples(st.sampled_from(OUTCOMES), st.sampled_from(OUTCOMES)), max_size=30))
def test_mcnemars_test_is_symmetric_and_a_probability(pairs):
    first, second = ([result(outcome=pair[i]) for pair in pairs] for i in (0, 1))
    p = mcnemar(first, second, "collided")
    assert p == pytest.approx(mcnemar(second, first, "collided"))
    assert 0.0 <= p <= 1.0
    assert mcnemar(first, first, "collided") == 1.0


def test_mcnemars_test_counts_discordant_pairs_alone():
    bad, good = result(outcome="collided"), result()
    assert mcnemar([bad] * 6 + [good] * 9, [good] * 15, "collided") == pytest.approx(2 * 0.5**6)
    assert mcnemar([bad] * 6, [good] * 6, "collided") == pytest.approx(2 * 0.5**6)
    assert mcnemar([bad] * 3 + [good] * 3, [good] * 3 + [bad] * 3, "collided") == 1.0


def test_realised_risk_is_the_mean_over_worlds_not_over_ticks():
    results = [result("a", broken=1, promises=2), result("b", broken=0, promises=98),
               result("c", promises=0)]  # fmt: skip
    found = realised_risk(results)
    assert found["value"] == pytest.approx(0.25)
    assert (found["low"], found["high"]) == pytest.approx((0.0, 0.5))
    assert realised_risk([result("a")]) is None
