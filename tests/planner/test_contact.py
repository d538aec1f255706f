"""Where a body on its way meets something, and the last resorts that depend on it."""

import numpy as np
import pytest

from foresee.mapping.body import first_contact
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from foresee.prediction import Prediction
from planner.motion.dynamics import rollout, swept
from planner.mpc.mpc import MPC
from planner.risk.risk_map import RiskMap
from planner.safety.collision import CollisionChecker
from planner.safety.contact import first_free, first_meeting, leads_on, swerves
from planner.safety.last_resort import LastResort

CAR = CarLimits()
DRIVING = (
    0.1,
    CAR.v_max,
    CAR.acceleration,
    CAR.braking,
    CAR.lateral_acceleration,
    CAR.max_curvature,
)
RESOLUTION, ORIGIN, HALVES = 0.05, (-1.0, -3.0), (0.25, 0.15)
STAGES = 32
NOWHERE = (np.zeros(1), 1.0, 0.05, (np.ones((120, 160), dtype=bool), RESOLUTION, ORIGIN, *HALVES))
"""Arcs all of which are barred."""


def scattered(seed, share=0.004):
    cells = np.random.default_rng(seed).random((120, 160)) < share
    cells[50:70, :40] = False
    return cells


def some_plan(seed):
    rng = np.random.default_rng(seed)
    state = np.array([0.0, 0.0, rng.uniform(-0.5, 0.5), rng.uniform(0.0, 3.0)])
    controls = np.column_stack([rng.uniform(-1.5, 1.0, STAGES), rng.uniform(-1.2, 1.2, STAGES)])
    return rollout(state, controls, *DRIVING)


@pytest.mark.parametrize("seed", range(30))
def test_the_first_meeting_is_that_of_the_swept_poses(seed):
    states, controls = some_plan(seed)
    blocked = scattered(seed)
    along, speed = first_meeting(states, controls, 0.1, 0.02, blocked, RESOLUTION, ORIGIN, *HALVES)
    poses = swept(states, controls, 0.1, 0.02)
    i = first_contact(blocked, RESOLUTION, ORIGIN, poses, *HALVES)
    if i < 0:
        assert (along, speed) == (-1.0, -1.0)
        return
    chords = np.hypot(*np.diff(poses[: i + 1, :2], axis=0).T).sum()
    assert along == pytest.approx(chords, abs=1e-3)
    lengths = np.concatenate([[0.0], np.cumsum(np.diff(_arcs(states, controls)))])
    k = min(int(np.searchsorted(lengths, along, side="right")) - 1, STAGES - 1)
    least, most = sorted(states[k : k + 2, 3])
    assert least - 1e-6 <= speed <= most + 1e-6


def _arcs(states, controls):
    """Distance travelled at each state [m]."""
    steps = 0.1 * states[:-1, 3] + 0.005 * controls[:, 0]
    return np.concatenate([[0.0], np.cumsum(steps)])


def test_a_body_that_stands_in_something_has_met_it():
    states, controls = some_plan(0)
    blocked = np.zeros((120, 160), dtype=bool)
    blocked[60, 20] = True
    assert first_meeting(states, controls, 0.1, 0.02, blocked, RESOLUTION, ORIGIN, *HALVES) == (
        0.0,
        states[0, 3],
    )


@pytest.mark.parametrize("seed", range(20))
def test_the_first_free_way_is_free_and_those_before_it_are_not(seed):
    ways = swerves(STAGES, CAR.braking, CAR.max_curvature)
    ways = np.nan_to_num(ways)
    state, first = np.array([0.0, 0.0, 0.0, 2.5]), np.array([0.5, 0.1])
    place = (scattered(seed, 0.02), RESOLUTION, ORIGIN, *HALVES)
    met = []
    for way in ways:
        controls = np.vstack([first, way[1:]])
        states, applied = rollout(state, controls, *DRIVING)
        poses = swept(states, applied, 0.1, 0.02)
        met.append(first_contact(*place[:3], poses, *HALVES) >= 0)
    found = first_free(state, first, ways, DRIVING, 0.02, place, False, NOWHERE)
    if found >= 0:
        assert not met[found]
    # A coarser look at other poses of the same way may find a corner that these poses miss.
    free = [i for i, hit in enumerate(met) if not hit]
    assert found in (free[:3] or [-1]) if found >= 0 else len(free) <= 2


def test_a_way_may_have_to_lead_on_from_its_end():
    ways = np.nan_to_num(swerves(STAGES, CAR.braking, CAR.max_curvature))
    state, first = np.array([0.0, 0.0, 0.0, 2.0]), np.zeros(2)
    place = (np.zeros((120, 160), dtype=bool), RESOLUTION, ORIGIN, *HALVES)
    barred = np.zeros((120, 160), dtype=bool)
    # A wall across, a little beyond where the car comes to rest if it goes straight on.
    barred[:, round((2.1 - ORIGIN[0]) / RESOLUTION) :] = True
    wall = (barred, RESOLUTION, ORIGIN, *HALVES)
    ends = [rollout(state, np.vstack([first, way[1:]]), *DRIVING)[0][-1] for way in ways]
    arcs = np.array([0.0, CAR.max_curvature, -CAR.max_curvature]), 2 * CAR.turning_radius, 0.05
    assert first_free(state, first, ways, DRIVING, 0.02, place, False, NOWHERE) == 0
    found = first_free(state, first, ways, DRIVING, 0.02, place, True, (*arcs, wall))
    assert found > 0
    leading = [leads_on(end, *arcs, wall) for end in ends]
    assert leading.index(True) == found
    assert first_free(state, first, ways, DRIVING, 0.02, place, True, NOWHERE) == -1


def test_swerves_brake_all_along_and_come_to_rest():
    ways = swerves(STAGES, CAR.braking, CAR.max_curvature)
    assert (ways[:, :, 0] == -CAR.braking).all()
    assert np.nanmax(abs(ways[:, :, 1])) == pytest.approx(CAR.max_curvature)
    assert np.isnan(ways[0, :, 1]).all()
    for way in np.nan_to_num(ways):
        states, _ = rollout(np.array([0.0, 0.0, 0.0, 4.0]), way, *DRIVING)
        assert states[-1, 3] < 1e-9
    assert len({way.tobytes() for way in np.nan_to_num(ways, nan=99.0)}) == len(ways)


@pytest.mark.parametrize("seed", [14, 16, 33, 38, 41, 43, 49, 51])
def test_a_last_resort_leads_on_where_the_plans_beginning_or_hard_braking_leaves_one(seed):
    mpc, checker = MPC(CAR), CollisionChecker(CAR, 0.1)
    rng = np.random.default_rng(seed)
    frame = GridFrame(0.05, (-5.0, -5.0), (200, 200))
    x, y = frame.centres()
    cells = np.full(frame.shape, FREE, np.int8)
    edge, side = rng.uniform(1.0, 2.5), rng.uniform(-0.6, 0.6)
    cells[:, x > edge] = UNKNOWN
    # A wall across half of the way, and one along it: together a corner.
    cells[np.ix_(y > side, x > rng.uniform(edge - 1.2, edge))] = OCCUPIED
    cells[y > rng.uniform(0.8, 2.0)] = OCCUPIED
    ones = np.ones(frame.shape, np.float32)
    belief = Prediction(frame, 0.95 * ones, 0.0 * ones, ones)
    risk = RiskMap.from_prediction(Grid(frame, cells), belief, 0.1)
    state = np.array([-1.0, 0.0, rng.uniform(-0.4, 0.4), rng.uniform(1.5, 3.0)])
    curvature = rng.uniform(-0.3, 0.3)
    controls = np.column_stack([np.full(mpc.stages, 1.0), np.full(mpc.stages, curvature)])
    controls[18:, 0] = -CAR.braking
    resort, plan = LastResort(mpc, checker), mpc.roll(state, controls)
    assert checker.contact(plan, ~risk.certain, risk.frame) is not None
    place, arcs = checker.body_in(~risk.certain, risk.frame), checker.arcs_in(risk)
    ways, begun = resort.ways(plan), [np.array([a, curvature]) for a in (1.0, -CAR.braking)]
    can_lead_on = [
        first_free(state, first, ways, mpc.driving, 0.02, place, True, arcs) >= 0 for first in begun
    ]
    driven, survivable = resort.begin(state, plan, risk)
    assert survivable
    last = mpc.roll(driven.states[1], resort.controls)
    assert checker.contact(last, ~risk.certain, risk.frame) is None
    assert any(can_lead_on)
    assert leads_on(last.states[-1], *arcs)
