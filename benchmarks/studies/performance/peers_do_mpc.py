"""Peer of the MPC: do-mpc, on the same problem."""

from __future__ import annotations

import warnings
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.performance.hall import SIDE, Solve, Solver, Tick
from benchmarks.studies.performance.hall_problem import Problem
from benchmarks.studies.performance.peers_casadi import COMPILED, IPOPT
from planner.mpc.mpc import MPC


def do_mpc(mpc: MPC, compiled: bool) -> Solver:
    """Return do-mpc's controller on a discrete model, started from its shifted last solution.

    The terms that read the map are added between `prepare_nlp` and `create_nlp`, which do-mpc
    allows, and the map is appended to do-mpc's own parameters. As one of these, it would be passed
    through all stage functions and their derivatives, and a solve would take twice as long. Only
    `solve` is timed, not `make_step`, which also records a history.

    Args:
        mpc: MPC whose problem is solved.
        compiled: whether casadi compiles the problem's functions to machine code. do-mpc's own
            `compile_nlp` fails in version 5.1.2, since it uses a name that it has not imported.
    """
    with warnings.catch_warnings():
        # do-mpc warns of optional features that are missing, and of future changes in casadi.
        warnings.simplefilter("ignore")
        controller, numbers = _controller(mpc, compiled)

    def prepare(tick: Tick) -> Solve:
        if tick.is_first:
            # Otherwise the solver would start from the multipliers of the previous drive.
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
    """Return do-mpc's controller of the whole problem, and the values of its own parameters.

    In the parameters of the problem, these are followed by the map's origin (2,) and its clearances
    (SIDE²,).
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
    # `setup` has replaced the symbols of the model.
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
