"""The exact test of drives for contacts."""

import math

import numpy as np
import pytest

from benchmarks.studies.contact_test import touches
from foresee.mapping.body import Body
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.control import Control
from foresee.mapping.grid import FREE, OCCUPIED, Grid, GridFrame
from sim import DubinsCar
from sim.world import World

FRAME = GridFrame(0.05, (0.0, 0.0), (60, 100))


def straight(y, yaw=0.0):
    """A drive along x at a height y [m]."""
    x = np.arange(1.0, 4.0, 0.3)
    return np.column_stack([x, np.full(len(x), y), np.full(len(x), yaw), np.full(len(x), 3.0)])


@pytest.mark.parametrize(
    ("y", "yaw", "hit"),
    [(1.0, 0.0, False), (1.79, 0.0, False), (1.9, 0.0, True), (1.75, 0.5, True)],
)
def test_the_independent_test_finds_what_the_body_touches(y, yaw, hit):
    solid = np.zeros(FRAME.shape, bool)
    # A post of one cell, with its near side at y = 1.95 m.
    solid[39, 50] = True
    assert Body().half_width == pytest.approx(0.15)
    assert touches(straight(y, yaw), solid, FRAME, Body()) == hit


def test_to_leave_the_map_is_to_touch():
    solid = np.zeros(FRAME.shape, bool)
    for states in (straight(0.1), straight(2.95), straight(1.0) + np.array([2.0, 0.0, 0.0, 0.0])):
        assert touches(states, solid, FRAME, Body())


def post(row=39, col=50):
    """Return a map with one solid cell; its lower left corner is at (col, row) · 0.05 m."""
    solid = np.zeros(FRAME.shape, bool)
    solid[row, col] = True
    return solid


@pytest.mark.parametrize("gap", [-0.001, 0.001])
def test_the_corner_of_a_turned_body_is_exact_to_a_millimetre(gap):
    # The post's lower right corner is at (2.55, 1.95); the body's left side, at 45°, is near it.
    away = (Body().half_width + gap) / math.sqrt(2.0)
    pose = np.array([2.55 + away, 1.95 - away, math.pi / 4, 0.0])
    assert touches(pose[None], post(), FRAME, Body()) == (gap < 0.0)


def test_a_body_that_only_lies_against_a_cell_does_not_touch():
    pose = np.array([[2.5, 1.95 - Body().half_width, 0.0, 0.0]])
    assert not touches(pose, post(), FRAME, Body())


@pytest.mark.parametrize("gear", [1, -1])
def test_between_two_states_the_body_is_followed_on_the_arc(gear):
    # A tight arc of 108° in one step: the straight line between its ends lies far inside.
    car = DubinsCar(CarLimits(reverse=4.0))
    start, control = np.array([2.5, 1.2, 0.0, gear * 1.0]), Control(0.0, 1.0 / 0.8, gear)
    middle, end = (car.step(start, control, 0.8 * turn * math.pi) for turn in (0.3, 0.6))
    states = np.array([start, end])
    for place, hit in ((middle, True), (0.5 * (start + end), False)):
        col, row = np.floor(place[:2] / 0.05).astype(int)
        assert touches(states, post(row, col), FRAME, Body()) == hit


def test_it_agrees_with_the_simulator():
    rng, car = np.random.default_rng(3), DubinsCar()
    cells = np.where(rng.random(FRAME.shape) < 0.003, OCCUPIED, FREE).astype(np.int8)
    world, found = World("posts", Grid(FRAME, cells)), []
    for _ in range(300):
        state = np.array([rng.uniform(1, 4), rng.uniform(1, 2), rng.uniform(-4, 4), 2.0])
        control = Control(0.0, rng.uniform(-0.7, 0.7), 1)
        states = np.array([state, car.step(state, control, 0.1)])
        judged = car.collides(world, state, control, 0.1)
        # The simulator's body is larger by a millimetre, and only the end of its step counts.
        exact, larger = (
            touches(states, world.solid, FRAME, Body().inflated(margin)) for margin in (0.0, 0.005)
        )
        assert exact <= judged or touches(states[:1], world.solid, FRAME, Body())
        assert judged <= larger
        found.append(judged)
    assert 50 < sum(found) < 250
