"""Recovery manoeuvres and turns that a search has found, and a car that has moved meanwhile."""

from concurrent.futures import Future

import numpy as np
import pytest
from drawn_maps import FRAME, grid

from foresee.mapping.car_limits import CarLimits
from foresee.mapping.grid import FREE
from planner.guide.guide import Guide
from planner.guide.guide_config import GuideConfig
from planner.guide.path_search import Found, SearchMemory
from planner.motion.path import Path
from planner.risk.risk_map import RiskMap

CAR = CarLimits(v_max=2.0, reverse=0.5, turn_rate=1.5, turning_radius=0.3)


def after_a_search(state, gear=1, **found):
    """A guide that was asked at the origin, and takes over what was found at a state."""
    known = grid(np.full(FRAME.shape, FREE, np.int8))
    risk = RiskMap.from_prediction(known.crop(known.frame.square(0.0, 0.0, 10.0)), None, 0.0)
    guide = Guide((8.0, 0.0), None, CAR, GuideConfig(), seed=1)
    guide.gear = gear
    request = guide._request(0, True, np.zeros(4), np.zeros(4), known, risk, None)
    guide._running = Future()
    guide._running.set_result(Found(request, SearchMemory(), **found))
    guide.take(np.array(state))
    return guide


@pytest.mark.parametrize("speed", [-0.4, 0.0])
def test_a_turn_on_the_spot_is_taken_over_only_by_a_car_that_stands(speed):
    guide = after_a_search([0.0, 0.0, 0.0, speed], gear=-1, turn_to=1.5)
    assert (guide.turn_to, guide.gear) == ((None, -1) if speed else (1.5, 1))


def with_legs(x, speed):
    legs = [(1, Path.through(np.array([[0.0, 0.0], [1.0, 0.0]]), "hybrid"))]
    return after_a_search([x, 0.0, 0.0, speed], legs=legs)


@pytest.mark.parametrize(
    ("x", "speed", "taken"),
    [(0.1, 0.0, True), (0.0, 0.3, True), (0.0, 1.0, False), (0.2, 0.0, False)],
)
def test_a_manoeuvre_is_taken_over_only_by_a_car_that_can_stop_where_it_begins(x, speed, taken):
    assert with_legs(x, speed).awaits_leg(np.array([x, 0.0, 0.0, 0.0])) == taken


def test_a_manoeuvre_is_given_up_when_the_car_has_come_away_from_where_it_begins():
    guide = with_legs(0.0, 0.3)
    assert not guide.awaits_leg(np.array([0.1, 0.0, 0.0, 0.3]))
    assert not guide.awaits_leg(np.array([0.2, 0.0, 0.0, 0.3]))
    assert not guide.awaits_leg(np.zeros(4))
