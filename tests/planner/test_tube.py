"""The tube of a plan: the car stays inside it, whatever its errors are within their bounds."""

import math

import numpy as np
import pytest

from foresee.mapping.body import Body
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.control import Control
from foresee.mapping.conventions import REST, TIGHTEST
from foresee.mapping.error_bounds import ErrorBounds
from planner.motion.dynamics import pose_along, rollout
from planner.safety.sent_controls import SentControls
from planner.safety.tube import carried_out, planned, radii
from sim import DubinsCar
from sim.errors import Actuators, PoseEstimate

CAR, DT = CarLimits(), 0.1
BOUNDS = {
    "delay": ErrorBounds(delay=0.2),
    "part of a tick": ErrorBounds(delay=0.13),
    "jitter": ErrorBounds(delay=0.1, jitter=0.05),
    "lag": ErrorBounds(lag=0.1),
    "long lag": ErrorBounds(lag=0.25),
    "short lag": ErrorBounds(delay=0.1, lag=1e-4),
    "pose": ErrorBounds(position=0.05, yaw=0.02),
    "all": ErrorBounds(delay=0.15, jitter=0.03, lag=0.1, position=0.05, yaw=0.02),
}


def corners(poses):
    """Return the corners of the body at poses (n, 3), (n, 4, 2) [m]."""
    cosine, sine = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    turns = np.moveaxis(np.array([[cosine, -sine], [sine, cosine]]), -1, 0)
    corner = np.array([(a, b) for a in (-1, 1) for b in (-1, 1)]) * CAR.body.halves
    return poses[:, None, :2] + np.einsum("nij,kj->nki", turns, corner)


def driven(actuators, car, state, control):
    """Return the states along a tick, the last one at its end."""
    states = []
    for acting, span in actuators.during(control, DT, abs(state[3]) >= REST):
        state = car.step(state, acting, span)
        states.append(state)
    return states


@pytest.mark.parametrize("name", [*BOUNDS])
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("bends", [0.0, 1.2])
def test_the_car_stays_in_the_tube_of_every_plan(name, seed, bends):
    bounds, rng = BOUNDS[name], np.random.default_rng(seed)
    limits = planned(CAR, bounds).driving
    car, actuators = DubinsCar(CAR), Actuators(bounds, rng)
    sent, estimate = SentControls(CAR, bounds, DT), PoseEstimate(bounds, rng)
    state = np.zeros(4)
    for _ in range(25):
        ahead, tube = sent.at_effect(estimate.of(state))
        # A plan that turns, brakes after a while, and holds the brake.
        controls = np.column_stack(
            [rng.uniform(-1.5, 1.5, 60), np.full(60, rng.uniform(-bends, bends))]
        )
        changes = int(rng.integers(1, 20))
        controls[:changes, 1] = rng.uniform(-bends, bends)
        controls[int(rng.integers(1, 15)) :, 0] = -CAR.braking
        states, applied = rollout(ahead, controls, DT, limits)
        # After its planned stop the car brakes on.
        applied[(states[:-1, 3] < 1e-6) & (states[1:, 3] < 1e-6), 0] = -CAR.braking
        _follows(bounds, tube, states, applied, car, state, actuators, rng)
        control = Control(*map(float, applied[0]))
        sent.add(control)
        state = driven(actuators, car, state, control)[-1]
    assert state[3] > 0.0 or seed


def test_a_car_that_turns_as_tightly_as_admitted_may_have_errors():
    body = Body(1.2484, 0.1255)
    car = CarLimits(body=body, turning_radius=1.01 * body.radius / TIGHTEST)
    guided = planned(car, BOUNDS["all"])
    assert guided.body.length > body.length
    assert guided.turning_radius > car.turning_radius
    assert planned(CAR, BOUNDS["all"]).turning_radius == CAR.turning_radius


def _follows(bounds, tube, states, controls, car, state, actuators, rng):
    """Check that a car that carries out all of a plan stays in its tube."""
    copy = Actuators(bounds, rng)
    for field in ("_time", "_acting", "_acceleration", "_curvature"):
        setattr(copy, field, getattr(actuators, field))
    copy._coming = actuators._coming.copy()
    path, times = [state], [0.0]
    for a, kappa in controls:
        for acting, span in copy.during(Control(a, kappa), DT, abs(path[-1][3]) >= REST):
            path.append(car.step(path[-1], acting, span))
            times.append(times[-1] + span)
    # The poses of the plan as it is carried out, close together, and the tube's radius at each.
    states, controls, commands, step = carried_out(tube, states, controls, DT)
    radius = radii(tube, states, controls, commands, step)
    poses, around = [], []
    for k, (a, kappa) in enumerate(controls):
        length = states[k, 3] * step + 0.5 * a * step * step
        for part in np.arange(0.0, length, 0.004):
            poses.append(pose_along(*states[k, :3], kappa, part))
            around.append(radius[k + 1] if k + 2 < len(radius) else radius[-2])
    poses.append(states[-1, :3])
    around.append(radius[-2])
    poses, around = np.array(poses), np.array(around)
    bodies = corners(poses)
    x, y, yaw = poses[-1]
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    for body, time in zip(corners(np.array(path)), times, strict=True):
        if time < bounds.shift + 0.5 * bounds.jitter:
            continue
        off = np.sqrt(((bodies - body) ** 2).sum(axis=2).max(axis=1)) - around
        beyond = np.abs((body - (x, y)) @ turn) - np.array(CAR.body.halves) - radius[-1]
        assert min(off.min(), beyond.max()) <= 0.003, (off.min(), beyond.max())
