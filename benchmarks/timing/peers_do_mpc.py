"""do-mpc on the MPC's problem."""

from __future__ import annotations

import warnings
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from benchmarks.timing.hall import SIDE, Solve, Solver, Tick
from benchmarks.timing.hall_problem import Problem
from benchmarks.timing.peers_casadi import COMPILED, IPOPT
from planner.mpc.mpc import MPC


def do_mpc(mpc: MPC, compiled: bool) -> Solver:
    """do-mpc's controller on a discrete model, started from the last solution, one tick on.

    What reads the map is added between `prepare_nlp` and `create_nlp`, as do-mpc offers, and the
    map behind do-mpc's own parameters: those go through all its stage functions and their
    derivatives, and with the map among them a solve takes twice as long. Only `solve` is timed,
    not `make_step`, which keeps a history beside it.

    Args:
        mpc: whose settings and limits count.
        compiled: whether the problem's functions are compiled to machine code; by casadi, for
            do-mpc's own `compile_nlp` fails in 5.1.2, on a name that it has not imported.
    """
    with warnings.catch_warnings():
        # Its import and its set-up warn of features that are not needed, and of casadi's future.
        warnings.simplefilter("ignore")
        controller, numbers = _controller(mpc, compiled)

    def prepare(tick: Tick) -> Solve:
        if tick.is_first:
            # Without this the multipliers of the drive before would be its start.
            controller.flags["initial_run"] = False
        plan = mpc.roll(tick.state, tick.guess)
        clearance = np.asarray(tick.risk.clearance, dtype=np.float64).ravel()
        numbers["_x0"] = tick.state
        numbers["_u_prev"] = np.array([0.0, tick.last])
        controller.opt_p_num = ca.vertcat(numbers, tick.risk.frame.origin, clearance)
        first: Any = controller.opt_x_num
        first["_x", :, 0, 0] = list(plan.states)
        first["_u", :, 0] = list(plan.controls)

        def solve() -> NDArray[np.float64] | None:
            controller.solve()
            if not controller.solver_stats["success"]:
                controller.flags["initial_run"] = False
                return None
            return np.asarray(ca.horzcat(*controller.opt_x_num["_u", :, 0])).T

        return solve

    return prepare


def _controller(mpc: MPC, compiled: bool) -> tuple[Any, Any]:
    """do-mpc's controller of the whole problem, and its own parameters' numbers.

    After those its problem has the map's origin (2,) and clearances (SIDE²,).
    """
    import do_mpc as library

    n, car, problem = mpc.stages, mpc.limits, Problem(mpc)
    model = library.model.Model("discrete", "MX")
    names, controls = ("x", "y", "yaw", "v"), ("a", "kappa")
    x = ca.vertcat(*(model.set_variable("_x", name) for name in names))
    u = ca.vertcat(*(model.set_variable("_u", name) for name in controls))
    for name, value in zip(names, ca.vertsplit(problem.successor(x, u)), strict=True):
        model.set_rhs(name, value)
    model.setup()
    # Setting it up has given it other symbols.
    x = ca.vertcat(*(model.x[name] for name in names))
    u = ca.vertcat(*(model.u[name] for name in controls))
    controller = library.controller.MPC(model)
    settings = controller.settings
    settings.n_horizon, settings.t_step = n, mpc.config.dt
    settings.store_lagr_multiplier = False
    settings.store_solver_stats = []
    settings.nlpsol_opts = {"print_time": False, "calc_lam_p": False} | IPOPT
    if compiled:
        settings.nlpsol_opts |= COMPILED
    controller.set_objective(lterm=problem.standing(x) + problem.effort(u), mterm=problem.ending(x))
    controller.set_rterm(kappa=mpc.config.smoothness)
    for which, sign, speed in (("lower", -1.0, 0.0), ("upper", 1.0, car.v_max)):
        controller.bounds[which, "_x", "v"] = speed
        controller.bounds[which, "_u", "a"] = -car.braking if sign < 0.0 else car.acceleration
        controller.bounds[which, "_u", "kappa"] = sign * car.max_curvature
        controller.terminal_bounds[which, "v"] = 0.0
        laterals = sign * problem.laterals(x, u)
        controller.set_nl_cons(f"lateral_{which}", laterals, ub=problem.lateral)
    controller.prepare_nlp()
    numbers = controller.opt_p_num
    origin, field = ca.MX.sym("origin", 2), ca.MX.sym("field", SIDE * SIDE)
    controller.opt_p = ca.vertcat(controller.opt_p, origin, field)
    for k in range(1, n + 1):
        clearances = problem.clearances(controller.opt_x["_x", k, 0, 0], origin, field)
        controller.nlp_obj += problem.closeness(clearances)
        if problem.keeps_inside:
            controller.nlp_cons.append(clearances)
            controller.nlp_cons_lb.append(np.full((2, 1), mpc.required))
            controller.nlp_cons_ub.append(np.full((2, 1), np.inf))
    controller.create_nlp()
    return controller, numbers
