"""Model-predictive control by direct transcription: plan how to follow a path and how to stop.

    minimise    Σ (- progress along the path + distance from it + effort
                   + change of curvature + closeness to unsafe cells)
    subject to  car dynamics and limits,
                the body inside the safe set at every stage,
                v_N = 0: every plan ends stopped, so that it is its own emergency plan.

It is solved by sequential quadratic programming: casadi computes the stages' exact Hessians, each
is projected to a positive semidefinite one, the states are eliminated (condensing), and daqp solves
the dense QP. If a step is taken in full, its matrices are used for a second one (Shamanskii 1967),
which often shows that nothing more can be gained. Every iterate is simulated with the exact
dynamics, so that the plan that is checked is the one that is driven.
The solver does not decide whether a plan is safe: `planner.safety.collision` tests it cell by cell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import ClassVar

import daqp
import numpy as np
from numpy.typing import NDArray

from foresee.mapping.car_limits import CarLimits
from foresee.mapping.conventions import TICK
from planner.motion.dynamics import rollout
from planner.motion.path import POINT_SPACING, Path
from planner.motion.plan import Plan
from planner.mpc import condense, constraints
from planner.mpc.clearance import add_closeness_gradient, add_closeness_hessian, clearances
from planner.mpc.codegen import compiled
from planner.mpc.initial_guess import LOOK, pursue
from planner.mpc.merit import Weights, merit
from planner.mpc.references import references
from planner.mpc.stages import NX, REFERENCE, stage_functions
from planner.risk.risk_map import RiskMap

CONSTRAINED_EXCESS = 1.0
"""Excess over the required clearance above which a circle has no constraint in the QP [m]."""
DOUBTFUL_GAIN = 10.0
"""Largest gain that a second step may predict without achieving any, in tolerances, for the
iteration to count as converged."""
DAQP_SETTINGS = {"rho_soft": 1e-4, "iter_limit": 500, "eps_prox": 0.0}
"""Settings of daqp: softness of the soft constraints, maximum number of iterations, and no proximal
term, since the Hessian is positive definite."""


@dataclass(frozen=True)
class MPCConfig:
    """Settings of the MPC.

    Attributes:
        dt: length of a step of the plan [s], which is that of a tick: each control lasts for one.
        progress: reward for a metre of progress, for each stage.
        contour: weight w of the cost w/2 · d² of each stage, with its distance d from the path [m].
        final: the same weight at the last stage, and cost of 1 - cos(heading error) there: a plan
            that ends on a drivable path ends where the car can go on.
        effort: costs of a² and of κ², for each stage.
        smoothness: cost of a squared change of κ from stage to stage.
        closeness: weight w of the cost w/2 · d² of each stage and circle that covers the body, with
            the shortfall d from the comfortable clearance [m].
        comfort: difference between the comfortable clearance and the required one [m].
        violation: cost of a shortfall of 1 m from the required clearance.
        margin: required distance of these circles from the edge of the safe set [m].
        curvature_step: maximum change of a curvature by one step of the SQP [1/m].
        iterations: maximum number of iterations of the SQP, of one or two steps each.
        tolerance: relative decrease of the merit below which the iteration stops.
    """

    dt: ClassVar[float] = TICK
    progress: float = 1.0
    contour: float = 1.0
    final: tuple[float, float] = (6.0, 12.0)
    effort: tuple[float, float] = (0.01, 0.02)
    smoothness: float = 0.1
    closeness: float = 4.0
    comfort: float = 0.25
    violation: float = 100.0
    margin: float = 0.035
    curvature_step: float = 0.6
    iterations: int = 10
    tolerance: float = 1e-4

    @property
    def weights(self) -> Weights:
        """The weights of the cost, as kernels read them."""
        return Weights(
            self.progress,
            self.contour,
            *self.final,
            *self.effort,
            self.smoothness,
            self.closeness,
            self.comfort,
            self.violation,
        )


class Status(StrEnum):
    """How the search for a plan ended."""

    CONVERGED = "converged"
    ITERATION_LIMIT = "iteration_limit"
    QP_FAILED = "qp_failed"
    NOT_FINITE = "not_finite"


@dataclass(frozen=True, eq=False)
class Solution:
    """The result of `MPC.solve`.

    Attributes:
        plan: the best plan found, which may be unsafe.
        cost: merit of the plan; lower is better.
        status: how the search ended.
    """

    plan: Plan
    cost: float
    status: Status

    @property
    def failed(self) -> bool:
        """Whether the solver itself reports a failure."""
        return self.status in (Status.QP_FAILED, Status.NOT_FINITE)


@dataclass
class _Problem:
    """The data of one tick's optimal-control problem; see `MPC.solve`."""

    state: NDArray[np.float64]
    path: Path
    segment: int
    risk: RiskMap
    last_curvature: float


@dataclass(frozen=True)
class _QP:
    """A quadratic program, linearised at some controls, with its matrices factorised.

    Attributes:
        model: model of daqp that holds the matrices.
        near: index of state and of circle of each clearance that is constrained, (n, 2).
    """

    model: daqp.Model
    near: NDArray[np.int64]


@dataclass(frozen=True)
class _Step:
    """The solution of a QP.

    Attributes:
        controls: change of the controls, (N, 2).
        gain: decrease of the cost that the QP predicts; infinite if the controls at which it was
            linearised exceed a limit or lack clearance.
        limits: multipliers of the car's limits, in the QP's order, positive at an upper one, (4N,).
        clearance: multipliers of the clearances of each state's two circles, (N+1, 2), none
            negative.
    """

    controls: NDArray[np.float64]
    gain: float
    limits: NDArray[np.float64]
    clearance: NDArray[np.float64]


@dataclass
class MPC:
    """The solver: build it once, and call `solve` in every tick.

    Attributes:
        limits: limits and body of the car.
        config: settings.
        stages: number N of steps of a plan.
        required: clearance that the circles around the body need [m].
        growth: additional clearance that they need at each state of a plan, (N+1,), or at all of
            them, (1,) [m].
    """

    limits: CarLimits = field(default_factory=CarLimits)
    config: MPCConfig = field(default_factory=MPCConfig)

    def __post_init__(self) -> None:
        c, car = self.config, self.limits
        self.stages = math.ceil(car.v_max / (car.braking * c.dt)) + 5
        n = self.stages + 1
        self._stage = compiled(stage_functions(c.dt, n, np.array(c.effort)))
        # Two circles cover the body. On straights at up to 5 m/s, those of successive states leave
        # no gap.
        offsets, radius = car.body.circles(2)
        self._offset, self.required = float(offsets[-1]), radius + c.margin
        self._driving, self._weights = car.driving, c.weights
        self.growth = np.zeros(1)
        # Number of a path's segments that one step may advance.
        self._reach = math.ceil(2.0 * car.v_max * c.dt / POINT_SPACING) + 2
        self._io = {
            "z": np.zeros((n, 6)),
            "multiplier": np.zeros((n, NX)),
            "reference": np.zeros((n, REFERENCE)),
            "jacobian": np.zeros((n, 6, NX)),
            "gradient": np.zeros((n, 6)),
            "hessian": np.zeros((n, 6, 6)),
        }
        self._buffer, self._evaluate = self._stage.buffer()
        for i, name in enumerate(("z", "multiplier", "reference")):
            self._buffer.set_arg(i, memoryview(self._io[name]))  # type: ignore[call-arg,arg-type]
        for i, name in enumerate(("jacobian", "gradient", "hessian")):
            self._buffer.set_res(i, memoryview(self._io[name]))  # type: ignore[call-arg,arg-type]

    def roll(self, state: NDArray[np.float64], controls: NDArray[np.float64]) -> Plan:
        """Return the plan that results from controls (N, 2), clipped to the car's limits."""
        return Plan(*rollout(state, controls, self.config.dt, self._driving))

    def pursue(
        self,
        state: NDArray[np.float64],
        path: Path,
        segment: int,
        look: float = LOOK,
        free: float = math.inf,
    ) -> NDArray[np.float64]:
        """Return controls (N, 2) that follow a path by pure pursuit, as an initial guess.

        Args:
            state: current x, y, yaw, v of the car, (4,).
            path: path to follow.
            segment: index of the path's segment near which the car is.
            look: distance of the point to aim at, at least [m].
            free: distance within which the car is to stop [m].
        """
        limits = self._driving._replace(cornering=self.limits.lateral_acceleration)
        n, dt = self.stages, self.config.dt
        return np.asarray(pursue(path.points, segment, state, n, dt, limits, look, min(free, 1e6)))

    def solve(
        self,
        state: NDArray[np.float64],
        path: Path,
        risk: RiskMap,
        guess: NDArray[np.float64],
        segment: int = 0,
        last_curvature: float = 0.0,
    ) -> Solution:
        """Improve a guess of the controls until it converges.

        Args:
            state: current x, y, yaw, v of the car, (4,).
            path: path along which the car is to make progress.
            risk: risk map in whose safe set the body is to stay.
            guess: initial guess of the controls, (N, 2).
            segment: index of the path's segment near which the car is.
            last_curvature: curvature of the last tick's control [1/m].

        Returns:
            The best plan found. It may leave the safe set: `CollisionChecker` has to test it.

        Raises:
            ValueError: if state or guess are not finite.
        """
        if not (np.isfinite(state).all() and np.isfinite(guess).all()):
            raise ValueError("state and guess must be finite")
        problem = _Problem(state, path, segment, risk, last_curvature)
        states, controls = rollout(state, guess, self.config.dt, self._driving)
        cost = self._merit(problem, states, controls)
        step: _Step | None = None
        status = Status.ITERATION_LIMIT
        for _ in range(self.config.iterations):
            qp, step = self._first_step(problem, states, controls, step)
            if step is None:
                status = Status.QP_FAILED
                break
            before = cost
            length, states, controls, cost = self._search(problem, states, controls, cost, step)
            little = self.config.tolerance * (1.0 + abs(cost))
            if before - cost <= little:
                status = Status.CONVERGED
                break
            # A QP whose step was shortened is too inaccurate for a second step.
            second = self._second_step(qp, problem, states, controls) if length == 1.0 else None
            if second is None:
                continue
            step, before = second, cost
            if step.gain > little:
                _, states, controls, cost = self._search(problem, states, controls, cost, step)
            # A step that gains much less than it predicts shows that the QP is inaccurate, and not
            # that the plan is optimal.
            if before - cost <= little and step.gain <= DOUBTFUL_GAIN * little:
                status = Status.CONVERGED
                break
        if not math.isfinite(cost):
            status = Status.NOT_FINITE
        return Solution(Plan(states, controls), cost, status)

    def evaluate(
        self, plan: Plan, path: Path, risk: RiskMap, segment: int, last_curvature: float
    ) -> float:
        """Return the cost of a plan: the merit that `solve` lowers."""
        problem = _Problem(plan.states[0], path, segment, risk, last_curvature)
        return self._merit(problem, plan.states, plan.controls)

    def lag(self, plan: Plan, path: Path, segment: int) -> float:
        """Return the part of a plan's cost that depends on its distance and progress on a path."""
        return float(self._references(path, segment, plan.states[1:])[1].sum())

    def _references(
        self, path: Path, segment: int, states: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return references(path.points, segment, states, self._reach, self._weights)

    def _clearances(
        self, problem: _Problem, states: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the clearance of both circles at each state (n, 2), and its gradient (n, 2, 3)."""
        risk = problem.risk
        value, normal = clearances(risk.frame.field(risk.clearance), states, self._offset)
        return value - self.growth[-len(states) :, None], normal

    def _merit(
        self, problem: _Problem, states: NDArray[np.float64], controls: NDArray[np.float64]
    ) -> float:
        _, costs = self._references(problem.path, problem.segment, states[1:])
        value, _ = self._clearances(problem, states[1:])
        last = problem.last_curvature
        return merit(states, controls, last, costs, value, self.required, self._weights)

    def _search(
        self,
        problem: _Problem,
        states: NDArray[np.float64],
        controls: NDArray[np.float64],
        cost: float,
        step: _Step,
    ) -> tuple[float, NDArray[np.float64], NDArray[np.float64], float]:
        """Find the largest of some shares of a step that lowers the merit.

        Returns:
            The share, and the states, controls and merit after it; 0 and the present ones if no
            share lowers the merit.
        """
        for length in (1.0, 0.5, 0.2, 0.05):
            changed = controls + length * step.controls
            trial = rollout(problem.state, changed, self.config.dt, self._driving)
            value = self._merit(problem, *trial)
            if value < cost:
                return length, trial[0], trial[1], value
        return 0.0, states, controls, cost

    def _first_step(
        self,
        problem: _Problem,
        states: NDArray[np.float64],
        controls: NDArray[np.float64],
        last: _Step | None,
    ) -> tuple[_QP, _Step | None]:
        """Build and solve the QP at some controls; its step is None if that fails.

        `last` is the step that led to these controls; None if they are the initial guess.
        """
        c, io = self.config, self._io
        g, value, normal, lacking = self._first_order(problem, states, controls)
        clearance = np.zeros_like(value) if last is None else last.clearance
        condense.costates(io["jacobian"], io["gradient"], normal, clearance, io["multiplier"])
        self._evaluate()
        hessian = io["hessian"]
        add_closeness_hessian(hessian, lacking, normal, c.closeness)
        condense.make_positive(hessian, 1e-6)
        h, sensitivity = condense.condense(io["jacobian"], hessian)
        condense.add_smoothness(h, c.smoothness)
        near = constraints.nearby(value, self.required + CONSTRAINED_EXCESS)
        a, sense = constraints.rows(sensitivity, states, controls, normal, near, c.dt)
        lower, upper = self._bounds(states, controls, value, near)
        qp = _QP(daqp.Model(), near)
        qp.model.settings = DAQP_SETTINGS
        # Warm start with the active set of the guess, and later with that of the last QP.
        start = (
            {"primal_start": np.zeros(len(g))}
            if last is None
            else {"dual_start": np.append(last.limits, -clearance[near[:, 0], near[:, 1]])}
        )
        flag, _ = qp.model.setup(h, g, a, upper, lower, sense, **start)
        return qp, self._solve_qp(qp, flag, lower, upper, value)

    def _second_step(
        self, qp: _QP, problem: _Problem, states: NDArray[np.float64], controls: NDArray[np.float64]
    ) -> _Step | None:
        """Solve a QP again at new controls, with its old matrices; return None if that fails."""
        g, value, _, _ = self._first_order(problem, states, controls)
        lower, upper = self._bounds(states, controls, value, qp.near)
        flag = qp.model.update(f=g, bupper=upper, blower=lower)
        return self._solve_qp(qp, flag, lower, upper, value)

    def _solve_qp(
        self,
        qp: _QP,
        flag: int,
        lower: NDArray[np.float64],
        upper: NDArray[np.float64],
        value: NDArray[np.float64],
    ) -> _Step | None:
        """Solve a QP, and return its step; None if it was not set up or has no solution.

        Args:
            qp: quadratic program.
            flag: daqp's flag of the setup, negative after a failure.
            lower: lower bounds of the variables and constraints, (4N + n,).
            upper: upper bounds, (4N + n,).
            value: clearances at the present controls, (N+1, 2) [m].
        """
        if flag < 0:
            return None
        step, cost, flag, info = qp.model.solve()
        if flag not in (1, 2) or not np.isfinite(step).all():
            return None
        feasible = lower.max() <= 1e-6 and upper.min() >= -1e-6
        feasible = feasible and value[1:].min() >= self.required - 1e-6
        multipliers, limits = np.asarray(info["lam"]), 2 * step.size
        clearance = np.zeros_like(value)
        clearance[qp.near[:, 0], qp.near[:, 1]] = np.maximum(0.0, -multipliers[limits:])
        gain = -cost if feasible else math.inf
        return _Step(np.asarray(step).reshape(-1, 2), gain, multipliers[:limits].copy(), clearance)

    def _first_order(
        self, problem: _Problem, states: NDArray[np.float64], controls: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Evaluate the first derivatives at some controls.

        Returns:
            Gradient of the cost with respect to the controls (2N,), clearances (N+1, 2) [m], their
            gradients (N+1, 2, 3), and shortfalls from the comfortable clearance (N+1, 2) [m].
        """
        c, io, n = self.config, self._io, self.stages
        io["z"][:, :4] = states
        io["z"][:n, 4:] = controls
        io["reference"][1:], _ = self._references(problem.path, problem.segment, states[1:])
        io["reference"][0] = 0.0
        io["multiplier"][:] = 0.0
        self._evaluate()
        value, normal = self._clearances(problem, states)
        lacking = np.maximum(0.0, self.required + c.comfort - value)
        lacking[0] = 0.0
        add_closeness_gradient(io["gradient"], lacking, normal, c.closeness)
        g = condense.condense_gradient(io["jacobian"], io["gradient"])
        condense.add_smoothness_gradient(g, controls, problem.last_curvature, c.smoothness)
        return g, value, normal, lacking

    def _bounds(
        self,
        states: NDArray[np.float64],
        controls: NDArray[np.float64],
        value: NDArray[np.float64],
        near: NDArray[np.int64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        c, lacking = self.config, self.required - value[near[:, 0], near[:, 1]]
        return constraints.bounds(states, controls, lacking, c.dt, self._driving, c.curvature_step)
