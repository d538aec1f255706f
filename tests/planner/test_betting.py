"""The test by betting that `benchmarks.calibrate` certifies levels with."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.risk.betting import LOST, capital, decided_after


@given(st.lists(st.floats(0, 1), max_size=60), st.floats(0.001, 0.999))
def test_the_capital_begins_near_one_and_never_becomes_negative(losses, bound):
    money = capital(losses, bound)
    assert money.shape == (len(losses),)
    assert (money >= 0).all()
    if losses:
        assert money[0] <= 1.0 + bound / (1.0 - bound)


@given(st.lists(st.floats(0, 1), min_size=2, max_size=40), st.data())
def test_a_larger_loss_never_makes_the_gambler_richer(losses, data):
    worse = list(losses)
    where = data.draw(st.integers(0, len(losses) - 1))
    worse[where] = data.draw(st.floats(losses[where], 1))
    assert (capital(worse, 0.1) <= capital(losses, 0.1) + 1e-12).all()


def test_no_bet_gains_on_average_where_the_mean_is_the_bound():
    bound = 0.2
    outcomes = [
        (bound**a * (1 - bound) ** b, capital([x, y, z], bound)[-1])
        for x in (0, 1)
        for y in (0, 1)
        for z in (0, 1)
        for a, b in [(x + y + z, 3 - x - y - z)]
    ]
    assert sum(chance * money for chance, money in outcomes) == pytest.approx(1.0)


@pytest.mark.parametrize("bound", [0.05, 0.02])
def test_false_certificates_are_as_rare_as_promised(bound):
    rng = np.random.default_rng(0)
    wrong = sum((capital(rng.random(1000) < bound, bound) >= 10).any() for _ in range(1000))
    # 0.1 of 1000, and three standard deviations.
    assert wrong < 100 + 3 * 9.5


@pytest.mark.parametrize(("bound", "drives"), [(0.05, 70), (0.02, 177), (0.01, 355)])
def test_drives_without_a_collision_convince_soon(bound, drives):
    money = capital(np.zeros(400), bound)
    assert np.argmax(money >= 10) + 1 == drives


def test_a_rate_far_below_the_bound_is_nearly_always_certified():
    rng = np.random.default_rng(1)
    found = sum((capital(rng.random(500) < 0.015, 0.05) >= 10).any() for _ in range(200))
    assert found > 190


def test_a_test_is_decided_after_its_last_drive_and_not_before_if_it_may_still_succeed():
    clean = np.zeros(60)
    best = capital(clean, 0.05)[-1]
    assert decided_after(clean, 0.05, 60, 1.001 * best) == 60
    assert decided_after(clean[:-1], 0.05, 60, 0.999 * best) is None


def test_a_test_that_no_clean_drives_can_save_is_given_up():
    # One collision, and 20 drives to come.
    losses = [0.0, 1.0, *np.zeros(18)]
    assert capital([*losses, *np.zeros(20)], 0.05)[-1] < 10
    assert decided_after(losses, 0.05, 40, 10) is not None


@given(st.lists(st.sampled_from([0.0, 0.0, 0.0, 1.0]), min_size=1, max_size=80))
def test_only_lost_capital_ends_a_test_that_clean_drives_could_still_win(losses):
    most, wanted, bound = 120, 10.0, 0.2
    end = decided_after(losses, bound, most, wanted)
    if end is not None:
        money = capital(losses[:end], bound)
        won = capital([*losses[:end], *np.zeros(most - end)], bound)[-1] >= wanted
        assert money[-1] >= wanted or money[-1] < LOST or not won
