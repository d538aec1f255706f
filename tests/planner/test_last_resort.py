"""The manoeuvre that stops the car within certain cells, in every tick."""

import numpy as np
import pytest

from foresee.mapping.car_limits import CarLimits
from foresee.mapping.grid import FREE, UNKNOWN, Grid, GridFrame
from foresee.prediction import Prediction
from planner.mpc.mpc import MPC
from planner.risk.risk_map import RiskMap
from planner.safety.collision import CollisionChecker
from planner.safety.last_resort import LastResort

CAR, DT = CarLimits(), 0.1
CHECKER = CollisionChecker(CAR, DT)
FRAME = GridFrame(0.05, (-2.0, -3.0), (120, 160))


@pytest.fixture(scope="module")
def mpc() -> MPC:
    return MPC(CAR)


def risk_of(cells) -> RiskMap:
    """The risk map of a prediction that all unobserved cells are free: safe, but not certain."""
    ones = np.ones(FRAME.shape, np.float32)
    return RiskMap.from_prediction(Grid(FRAME, cells), Prediction(FRAME, ones, 0 * ones, ones), 0.1)


def onward(mpc, speed):
    """A car at the origin, and a plan that accelerates before it stops."""
    controls = np.zeros((mpc.stages, 2))
    controls[:, 0] = -CAR.braking
    controls[:4, 0] = 1.0
    state = np.array([0.0, 0.0, 0.0, speed])
    return state, mpc.roll(state, controls)


@pytest.mark.parametrize("seed", range(12))
def test_what_is_kept_meets_no_single_cell_that_is_uncertain(mpc, seed):
    cells = np.full(FRAME.shape, FREE, np.int8)
    cells[np.random.default_rng(seed).random(FRAME.shape) < 0.004] = UNKNOWN
    cells[50:70, :50] = FREE
    risk = risk_of(cells)
    state, plan = onward(mpc, 2.0)
    resort = LastResort(mpc, CHECKER)
    driven, survivable = resort.begin(state, plan, risk)
    assert CHECKER.is_safe(driven, risk)
    if survivable:
        kept = mpc.roll(driven.states[1], resort.controls)
        assert kept.states[-1, 3] == pytest.approx(0.0, abs=1e-9)
        assert CHECKER.contact(kept, ~risk.certain, FRAME) is None


@pytest.mark.parametrize(("room", "survivable"), [(0.3, False), (3.0, True)])
def test_a_car_is_told_whether_a_last_resort_remains(mpc, room, survivable):
    cells = np.full(FRAME.shape, FREE, np.int8)
    cells[:, FRAME.centres()[0] > CAR.body.half_length + room] = UNKNOWN
    risk = risk_of(cells)
    state, plan = onward(mpc, 3.0)
    assert CHECKER.contact(plan, ~risk.certain, FRAME) is not None
    driven, remains = LastResort(mpc, CHECKER).begin(state, plan, risk)
    assert remains is survivable
    if not remains:
        assert driven.controls[0, 0] == pytest.approx(-CAR.braking)
