"""Every plan that is driven was found safe on the newest map, whatever its maker says."""

import numpy as np
from short_drive import LIDAR, navigator, straight

from foresee.mapping.grid import OCCUPIED, Grid
from planner.mpc.mpc import Solution, Status
from sim import DubinsCar
from sim.world import World


def test_a_solver_that_plans_into_a_wall_and_reports_success_is_not_followed():
    task, car = straight(), DubinsCar()
    driver = navigator(task)
    mpc = driver.chooser.mpc

    def solve(state, *_):
        controls = np.tile([-mpc.limits.braking, 0.0], (mpc.stages, 1))
        controls[:12] = 1.0, 0.5
        return Solution(mpc.roll(state, controls), 0.0, Status.CONVERGED)

    mpc.solve = solve
    state = np.array([*task.start, 0.0])
    for _ in range(40):
        decision = driver.step(state, LIDAR.scan(task.world, state))
        assert not decision.emergency
        assert driver.chooser.checker.is_safe(decision.plan, decision.risk_map)
        assert not car.collides(task.world, state, decision.control, 0.1)
        state = car.step(state, decision.control, 0.1)
    assert driver.faults["no_safe_solution"] > 10


def test_a_wall_that_appears_too_near_to_stop_is_an_emergency():
    task, car = straight(), DubinsCar()
    driver = navigator(task)
    state = np.array([*task.start, 0.0])
    for _ in range(15):
        decision = driver.step(state, LIDAR.scan(task.world, state))
        state = car.step(state, decision.control, 0.1)
    assert state[3] > 1.0
    grid = task.world.grid
    cells, (x, _) = grid.cells.copy(), grid.frame.centres()
    ahead = x - state[0] - car.limits.body.half_length
    cells[:, (ahead > 0.7) & (ahead < 0.9)] = OCCUPIED
    blocked = World("blocked", Grid(grid.frame, cells))
    # It takes three scans until cells that were seen free count as occupied.
    for _ in range(3):
        decision = driver.step(state, LIDAR.scan(blocked, state))
        state = car.step(state, decision.control, 0.1)
    assert decision.emergency
    assert not driver.chooser.checker.is_safe(decision.plan, decision.risk_map)
    assert decision.control.acceleration == -car.limits.braking
