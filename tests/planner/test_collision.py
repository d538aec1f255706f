"""A plan is safe only if no part of the body, anywhere on its way, enters what it may not."""

import math

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from foresee.mapping.body import Body
from foresee.mapping.car_limits import CONTACT_MARGIN, JUDGE_MARGIN, CarLimits
from foresee.mapping.control import Control
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from planner.motion.dynamics import rollout
from planner.motion.plan import Plan
from planner.mpc.mpc import MPC
from planner.risk.risk_map import RiskMap
from planner.safety.collision import CollisionChecker, swept_cells
from sim.car import DubinsCar
from sim.world import World

CAR, DT = CarLimits(), 0.1
CHECKER = CollisionChecker(CAR, DT)
FRAME = GridFrame(0.05, (-2.0, -3.0), (120, 160))


@pytest.fixture(scope="module")
def mpc() -> MPC:
    return MPC(CAR)


def leads_on(cells) -> bool:
    """Whether the car can go on from the origin, along the x axis or on some arc."""
    risk = risk_of(cells)
    return CHECKER.leads_on(np.zeros(3), risk.barred, risk.frame)


def risk_of(cells) -> RiskMap:
    return RiskMap.from_prediction(Grid(FRAME, cells), None, 0.0)


def room() -> np.ndarray:
    return np.full(FRAME.shape, FREE, np.int8)


def some_plan(mpc: MPC, seed: int) -> Plan:
    rng = np.random.default_rng(seed)
    controls = np.column_stack([np.full(mpc.stages, -CAR.braking), np.full(mpc.stages, 0.0)])
    controls[:, 1] = np.repeat(rng.uniform(-1.2, 1.2, 8), 5)[: mpc.stages]
    state = np.array([0.0, 0.0, rng.uniform(-0.5, 0.5), rng.uniform(1.0, 3.0)])
    return mpc.roll(state, controls)


def touched(plan: Plan) -> np.ndarray:
    """Cells that the body overlaps at poses 1 mm apart, of its outline and inside: (rows, cols)."""
    body, r = CAR.body, FRAME.resolution
    along = np.arange(-body.half_length, body.half_length + 1e-9, 0.01)
    across = np.arange(-body.half_width, body.half_width + 1e-9, 0.01)
    a, b = (m.ravel() for m in np.meshgrid(along, across))
    hit = np.zeros(FRAME.shape, bool)
    for x, y, yaw in plan.poses(DT, 0.001):
        px = x + a * math.cos(yaw) - b * math.sin(yaw)
        py = y + a * math.sin(yaw) + b * math.cos(yaw)
        hit[((py - FRAME.origin[1]) / r).astype(int), ((px - FRAME.origin[0]) / r).astype(int)] = 1
    return hit


@pytest.mark.parametrize("seed", range(12))
def test_no_cell_that_a_much_finer_sweep_touches_is_missed(mpc, seed):
    plan = some_plan(mpc, seed)
    hit = touched(plan)
    # The cells at the edge of what is swept are those that a coarse sweep may miss.
    inner = hit[1:-1, 1:-1] & hit[:-2, 1:-1] & hit[2:, 1:-1] & hit[1:-1, :-2] & hit[1:-1, 2:]
    edge = hit.copy()
    edge[1:-1, 1:-1] &= ~inner
    cells = np.argwhere(edge)
    for row, col in cells[:: max(1, len(cells) // 60)]:
        blocked = np.zeros(FRAME.shape, bool)
        blocked[row, col] = True
        assert CHECKER.contact(plan, blocked, FRAME) is not None


@pytest.mark.parametrize("seed", range(12))
def test_what_lies_well_beside_the_way_is_not_met(mpc, seed):
    plan = some_plan(mpc, seed)
    poses = plan.poses(DT, 0.02)
    x, y = FRAME.centres()
    # Half a diagonal of a cell, and what the body is inflated by.
    reach = math.hypot(CAR.body.half_length, CAR.body.half_width) + 0.036 + 0.022
    near = np.hypot(x[None, :, None] - poses[:, 0], y[:, None, None] - poses[:, 1]).min(axis=2)
    assert CHECKER.contact(plan, near > reach, FRAME) is None


def test_a_plan_with_a_state_that_is_not_finite_is_not_safe(mpc):
    plan = some_plan(mpc, 0)
    assert CHECKER.is_safe(plan, risk_of(room()))
    for i in range(4):
        states = plan.states.copy()
        states[-1, i] = math.nan
        assert not CHECKER.is_safe(Plan(states, plan.controls), risk_of(room()))


def test_beyond_the_map_nothing_is_safe(mpc):
    straight = np.column_stack([np.full(mpc.stages, -CAR.braking), np.zeros(mpc.stages)])
    for x, safe in ((3.0, True), (4.5, False)):
        plan = mpc.roll(np.array([x, 0.0, 0.0, 2.0]), straight)
        assert CHECKER.is_safe(plan, risk_of(room())) is safe


def test_the_first_contact_is_told_where_and_how_fast(mpc):
    cells = room()
    wall = 1.5
    cells[:, FRAME.centres()[0] > wall] = OCCUPIED
    straight = np.column_stack([np.full(mpc.stages, -CAR.braking), np.zeros(mpc.stages)])
    plan = mpc.roll(np.array([0.0, 0.0, 0.0, 3.0]), straight)
    met = CHECKER.contact(plan, cells == OCCUPIED, FRAME)
    assert met is not None
    along, speed = met
    assert along == pytest.approx(wall - CAR.body.half_length, abs=0.05)
    assert speed == pytest.approx(math.sqrt(9.0 - 2 * CAR.braking * along), abs=0.02)


@pytest.mark.parametrize(("gap", "leads"), [(0.1, False), (3.0, True)])
def test_a_car_leads_on_from_where_some_arc_has_room(gap, leads):
    cells = room()
    x, _ = FRAME.centres()
    cells[:, x > CAR.body.half_length + gap] = OCCUPIED
    y = FRAME.centres()[1]
    cells[abs(y) > CAR.body.half_width + 0.1] = OCCUPIED
    assert leads_on(cells) is leads


@pytest.mark.parametrize("side", [1, -1])
def test_a_cell_that_only_a_swinging_corner_enters_is_met(side):
    # A long car, whose rear swings out far in a tight turn.
    car = CarLimits(turning_radius=0.4, body=Body(1.0, 0.3))
    controls = np.array([[0.0, side * car.max_curvature]] * 4 + [[-car.braking, 0.0]] * 10)
    start = np.array([0.0, 0.0, 0.0, 0.77])
    plan = Plan(*rollout(start, controls, DT, car.driving))
    checker = CollisionChecker(car, DT)
    # The rear corner on the outside of the turn, half a millimetre inside the body.
    back, out = car.body.half_length - 5e-4, car.body.half_width - 5e-4
    blocked = np.zeros((120, 120), dtype=bool)
    blocked[60, 60] = True
    poses = plan.poses(DT, 5e-4)
    for x, y, yaw in poses[np.abs(poses[:, 2]) < 0.5]:
        px = x - back * math.cos(yaw) + side * out * math.sin(yaw)
        py = y - back * math.sin(yaw) - side * out * math.cos(yaw)
        # The corner of a cell of 5 cm that lies outside and behind.
        frame = GridFrame(0.05, (px - 61 * 0.05, py - (61 if side > 0 else 60) * 0.05), (120, 120))
        assert checker.contact(plan, blocked, frame) is not None


def test_a_plan_that_does_not_end_at_rest_is_not_safe(mpc):
    controls = np.zeros((5, 2))
    plan = mpc.roll(np.array([0.0, 0.0, 0.0, 0.3]), controls)
    assert CHECKER.contact(plan, ~risk_of(room()).safe, FRAME) is None
    assert not CHECKER.is_safe(plan, risk_of(room()))


@pytest.mark.parametrize("cell", [UNKNOWN, OCCUPIED])
def test_a_plan_into_what_was_not_observed_free_is_not_safe(mpc, cell):
    straight = np.column_stack([np.full(mpc.stages, -CAR.braking), np.zeros(mpc.stages)])
    plan = mpc.roll(np.array([0.0, 0.0, 0.0, 3.0]), straight)
    cells = room()
    assert CHECKER.is_safe(plan, risk_of(cells))
    cells[:, FRAME.centres()[0] > 2.0] = cell
    assert not CHECKER.is_safe(plan, risk_of(cells))


def test_a_car_leads_on_into_what_was_not_observed_but_not_towards_a_wall_near_or_far():
    x, y = FRAME.centres()
    for far in (0.4, 1.0):
        cells = room()
        cells[:, x > CAR.body.half_length + far] = OCCUPIED
        cells[abs(y) > CAR.body.half_width + 0.1] = OCCUPIED
        assert not leads_on(cells)
        cells[:, x > CAR.body.half_length + far] = UNKNOWN
        assert leads_on(cells)


@pytest.mark.parametrize("side", [1, -1])
def test_a_car_leads_on_around_a_wall_ahead(side):
    cells, (x, y) = room(), FRAME.centres()
    # A wall across, with room for a turn to one side of it alone.
    cells[:, x > CAR.body.half_length + 0.9] = OCCUPIED
    cells[-side * y > CAR.body.half_width + 0.1] = OCCUPIED
    assert leads_on(cells)


@pytest.mark.parametrize("seed", range(4))
def test_the_swept_cells_are_nearly_all_that_the_body_touches(mpc, seed):
    plan = some_plan(mpc, seed)
    every, swept = np.ones(FRAME.shape, bool), np.zeros(FRAME.shape, bool)
    swept[swept_cells(plan, DT, CAR.body, FRAME, every)] = True
    hit = touched(plan)
    assert (hit & swept).sum() > 0.97 * hit.sum()
    # Cells that the body only touches at its outline count too.
    assert (swept & ~binary_dilation(hit)).sum() == 0


BODIES = (
    CarLimits(),
    CarLimits(turning_radius=0.5, body=Body(2.0, 0.8)),
    CarLimits(turning_radius=0.3, body=Body(2.0, 0.8)),
    CarLimits(turning_radius=0.2, body=Body(0.4, 0.4)),
)
"""Cars; the body of the second and third swings out far for their turning radius."""


@pytest.mark.parametrize("car", BODIES)
@pytest.mark.parametrize("resolution", [0.01, 0.05, 0.15, 0.25, 0.5])
def test_what_is_safe_to_the_planner_is_no_collision_to_the_simulator(car, resolution):
    checker, judge = CollisionChecker(car, DT), DubinsCar(car)
    rng = np.random.default_rng(0)
    size = math.ceil(8.0 / resolution)
    frame = GridFrame(resolution, (-4.0, -4.0), (size, size))
    tight = 0.999 * car.max_curvature
    passed = 0
    for _ in range(100):
        speed = min(1.5, math.sqrt(0.99 * car.lateral_acceleration / tight))
        state = np.array([0.0, 0.0, rng.uniform(-math.pi, math.pi), speed])
        controls = np.tile([-0.3, rng.choice([-tight, tight])], (8, 1))
        states = np.array([state] * 9)
        for k, (a, curvature) in enumerate(controls):
            states[k + 1] = judge.step(states[k], Control(a, curvature), DT)
        plan = Plan(states, controls)
        cells = np.full(frame.shape, FREE, np.int8)
        # A wall of one cell, about as far away as a corner of the body reaches.
        away = car.body.radius * rng.uniform(0.6, 1.2) + 0.5 * resolution
        x, y = states[rng.integers(9), :2] + away * unit(rng)
        row, col = (round((v + 4.0) / resolution - 0.5) for v in (y, x))
        cells[row, col] = OCCUPIED
        blocked = cells == OCCUPIED
        if checker.contact(plan, blocked, frame) is not None:
            continue
        passed += 1
        world = World("cell", Grid(frame, cells))
        for k, (a, curvature) in enumerate(controls):
            assert not judge.collides(world, states[k], Control(a, curvature), DT)
    assert passed > 5


def unit(rng) -> np.ndarray:
    angle = rng.uniform(-math.pi, math.pi)
    return np.array([math.cos(angle), math.sin(angle)])


def test_the_planners_margin_covers_what_the_body_sweeps_and_the_simulators_margin():
    for car in BODIES:
        checker = CollisionChecker(car, DT)
        # While the car moves by the spacing, a corner moves by at most so much.
        corner = checker.spacing * (1.0 + car.max_curvature * car.body.radius)
        assert 0.5 * corner + JUDGE_MARGIN <= CONTACT_MARGIN + 1e-12


@pytest.mark.parametrize("size", [(-1.0, -1.0), (0.0, 0.3), (0.5, math.nan), (math.inf, 0.3)])
def test_a_body_has_a_size(size):
    with pytest.raises(ValueError, match="must be positive"):
        Body(*size)


def test_a_car_that_turns_far_inside_its_own_body_is_refused():
    with pytest.raises(ValueError, match=r"turning_radius is 0\.2 m, it must be at least 0\.2"):
        CarLimits(turning_radius=0.2, body=Body(2.0, 0.8))
