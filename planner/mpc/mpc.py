"""Model-predictive control by direct transcription: plan how to follow a path and how to stop.

    minimise    Σ progress along the path, distance from it, smoothness, closeness to the unsafe
    subject to  car dynamics and limits,
                the body inside the safe set at every stage,
                v_N = 0: every plan ends stopped, so that it is its own emergency plan.

Sequential quadratic programming: casadi derives the stages' exact Hessians, each is projected to
positive semidefinite, the states are condensed out, and daqp solves the dense QP. If the whole
step is taken, its matrices serve for a second one (Shamanskii 1967), which often shows that
nothing more can be gained. Every iterate is rolled out through the dynamics, so that the plan that
is checked is the one that is driven.
The solver does not decide whether a plan is safe: `planner.safety.collision` tests it cell by cell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum

import daqp
import numpy as np
from numpy.typing import NDArray

from planner.motion.dynamics import NX, REFERENCE, rollout, stage_functions
from planner.motion.path import SPACING, Path, references
from planner.motion.plan import Plan
from planner.mpc import condense, constraints
from planner.mpc.codegen import compiled
from planner.risk.risk_map import RiskMap
from predictor.mapping.car_limits import CarLimits
from predictor.mapping.conventions import TICK

NEAR = 1.0
"""Circles with more clearance than required by this have no row in the QP [m]."""
DOUBTED = 10.0
"""The iteration stops if a second step gains nothing and predicts at most this many tolerances."""
DAQP = {"rho_soft": 1e-4, "iter_limit": 500, "eps_prox": 0.0}
"""Settings of daqp: weight of soft rows; no proximal term, as the Hessian is positive definite."""


@dataclass(frozen=True)
class MPCConfig:
    """Settings of the MPC.

    Attributes:
        dt: step [s].
        progress: reward of a metre of progress, a stage.
        contour: cost of a squared metre off the path, a stage.
        final: cost of a squared metre off the path, and of 1 - cos(heading error), at the end: a
            plan that ends on a drivable path ends where the car can go on from.
        effort: cost of a² and of κ², a stage.
        smoothness: cost of a squared change of κ from stage to stage.
        closeness: cost of a squared metre of lacking comfort, a stage.
        comfort: clearance beyond the required one, below which it is lacking [m].
        violation: cost of a metre of lacking required clearance.
        margin: clearance required of the circles that cover the body, beyond its outline [m].
        curvature_step: maximum change of a curvature in one step [1/m].
        iterations: maximum number of iterations, of one or two steps each.
        tolerance: relative decrease of the merit by a step at which the iteration stops.
    """

    dt: float = TICK
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


class Status(StrEnum):
    """How a solve ended."""

    CONVERGED = "converged"
    ITERATION_LIMIT = "iteration_limit"
    QP_FAILED = "qp_failed"
    NOT_FINITE = "not_finite"


@dataclass(frozen=True, eq=False)
class Solution:
    """The result of a solve.

    Attributes:
        plan: the best plan found, which may be unsafe.
        cost: value of the plan's merit; lower is better.
        status: how the solve ended.
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
    """The quadratic program at some controls, in daqp, with its matrices factorised.

    Attributes:
        model: daqp's model.
        near: state and circle of each clearance row, (n, 2).
    """

    model: daqp.Model
    near: NDArray[np.int64]


@dataclass(frozen=True)
class _Step:
    """The solution of a QP.

    Attributes:
        controls: change of the controls, (N, 2).
        gain: decrease of the cost that the QP predicts; infinite where the controls before it
            break a limit or lack clearance.
        limits: multipliers of the car's limits, in the QP's order, positive at an upper one, (4N,).
        clearance: multipliers of the clearance of each state's two circles, (N+1, 2), none
            negative.
    """

    controls: NDArray[np.float64]
    gain: float
    limits: NDArray[np.float64]
    clearance: NDArray[np.float64]


@dataclass
class MPC:
    """The solver: build it once, and call `solve` at every tick."""

    limits: CarLimits = field(default_factory=CarLimits)
    config: MPCConfig = field(default_factory=MPCConfig)

    def __post_init__(self) -> None:
        c, car = self.config, self.limits
        self.stages = math.ceil(car.v_max / (car.braking * c.dt)) + 5
        n = self.stages + 1
        self._stage = compiled(stage_functions(c.dt, n, np.array(c.effort)))
        # Two circles cover the body. On straights they leave no gap at up to 5 m/s.
        offsets, radius = car.body.circles(2)
        self._offset, self.required = float(offsets[-1]), radius + c.margin
        # Arguments of `rollout`.
        self.driving = (c.dt, *car.driving, car.max_curvature)
        # Number of a path's segments that one step may advance.
        self._reach = math.ceil(2.0 * car.v_max * c.dt / SPACING) + 2
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
        """Return the plan that controls (N, 2) give from a state, clipped to the car's limits."""
        return Plan(*rollout(state, controls, *self.driving))

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
            state: x, y, yaw, v now, (4,).
            path: to make progress along.
            risk: whose safe set the body is to stay in.
            guess: controls to start from, (N, 2).
            segment: of the path, near which the car is.
            last_curvature: applied at the last tick [1/m].

        Returns:
            The best plan found. It may violate the safe set: ask a `CollisionChecker`.

        Raises:
            ValueError: if state or guess are not finite.
        """
        if not (np.isfinite(state).all() and np.isfinite(guess).all()):
            raise ValueError("state and guess must be finite")
        problem = _Problem(state, path, segment, risk, last_curvature)
        states, controls = rollout(state, guess, *self.driving)
        merit = self._merit(problem, states, controls)
        step: _Step | None = None
        status = Status.ITERATION_LIMIT
        for _ in range(self.config.iterations):
            qp, step = self._first_step(problem, states, controls, step)
            if step is None:
                status = Status.QP_FAILED
                break
            before = merit
            length, states, controls, merit = self._search(problem, states, controls, merit, step)
            little = self.config.tolerance * (1.0 + abs(merit))
            if before - merit <= little:
                status = Status.CONVERGED
                break
            # A QP whose own step was shortened is not used for a second one.
            second = self._second_step(qp, problem, states, controls) if length == 1.0 else None
            if second is None:
                continue
            step, before = second, merit
            if step.gain > little:
                _, states, controls, merit = self._search(problem, states, controls, merit, step)
            # If it predicts much and gains nothing, the QP is at fault, and the plan not final.
            if before - merit <= little and step.gain <= DOUBTED * little:
                status = Status.CONVERGED
                break
        if not math.isfinite(merit):
            status = Status.NOT_FINITE
        return Solution(Plan(states, controls), merit, status)

    def evaluate(
        self, plan: Plan, path: Path, risk: RiskMap, segment: int, last_curvature: float
    ) -> float:
        """Return the cost of a plan: the merit that `solve` lowers."""
        problem = _Problem(plan.states[0], path, segment, risk, last_curvature)
        return self._merit(problem, plan.states, plan.controls)

    def _references(
        self, problem: _Problem, states: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        c, points = self.config, problem.path.points
        refs, costs = references(
            points, problem.segment, states, self._reach, c.progress, c.contour, *c.final
        )
        return refs, costs

    def _clearances(
        self, problem: _Problem, states: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the two circles' clearance at each state (n, 2), and its gradient (n, 2, 3)."""
        risk = problem.risk
        value, gradient = condense.clearances(
            risk.clearance, *risk.frame.lattice, states, self._offset
        )
        return value, gradient

    def _merit(
        self, problem: _Problem, states: NDArray[np.float64], controls: NDArray[np.float64]
    ) -> float:
        c = self.config
        _, costs = self._references(problem, states[1:])
        value, _ = self._clearances(problem, states[1:])
        weights = c.comfort, c.effort, c.smoothness, c.closeness, c.violation
        return condense.merit(
            states, controls, problem.last_curvature, costs, value, self.required, *weights
        )

    def _search(
        self,
        problem: _Problem,
        states: NDArray[np.float64],
        controls: NDArray[np.float64],
        merit: float,
        step: _Step,
    ) -> tuple[float, NDArray[np.float64], NDArray[np.float64], float]:
        """Return the largest share of a step that lowers the merit, with what follows from it."""
        for length in (1.0, 0.5, 0.2, 0.05):
            trial = rollout(problem.state, controls + length * step.controls, *self.driving)
            value = self._merit(problem, *trial)
            if value < merit:
                return length, trial[0], trial[1], value
        return 0.0, states, controls, merit

    def _first_step(
        self,
        problem: _Problem,
        states: NDArray[np.float64],
        controls: NDArray[np.float64],
        last: _Step | None,
    ) -> tuple[_QP, _Step | None]:
        """Build and solve the QP at some controls, which `last` led to if they are no guess.

        The step is None if that fails.
        """
        c, io = self.config, self._io
        g, value, normal, lacking = self._first_order(problem, states, controls)
        clearance = np.zeros_like(value) if last is None else last.clearance
        condense.costates(io["jacobian"], io["gradient"], normal, clearance, io["multiplier"])
        self._evaluate()
        hessian = io["hessian"]
        condense.add_curvature(hessian, lacking, normal, c.closeness)
        condense.make_positive(hessian, 1e-6)
        h, sensitivity = condense.condense(io["jacobian"], hessian)
        condense.add_smoothness(h, c.smoothness)
        near = constraints.nearby(value, self.required + NEAR)
        a, sense = constraints.rows(sensitivity, states, controls, normal, near, c.dt)
        lower, upper = self._bounds(states, controls, value, near)
        qp = _QP(daqp.Model(), near)
        qp.model.settings = DAQP
        # Warm start: assume the active set of the guess, and later that of the last QP.
        start = (
            {"primal_start": np.zeros(len(g))}
            if last is None
            else {"dual_start": np.append(last.limits, -clearance[near[:, 0], near[:, 1]])}
        )
        flag, _ = qp.model.setup(h, g, a, upper, lower, sense, **start)
        return qp, self._solved(qp, flag, lower, upper, value)

    def _second_step(
        self, qp: _QP, problem: _Problem, states: NDArray[np.float64], controls: NDArray[np.float64]
    ) -> _Step | None:
        """Solve a QP at other controls, but with the same matrices; return None if that fails."""
        g, value, _, _ = self._first_order(problem, states, controls)
        lower, upper = self._bounds(states, controls, value, qp.near)
        flag = qp.model.update(f=g, bupper=upper, blower=lower)
        return self._solved(qp, flag, lower, upper, value)

    def _solved(
        self,
        qp: _QP,
        flag: int,
        lower: NDArray[np.float64],
        upper: NDArray[np.float64],
        value: NDArray[np.float64],
    ) -> _Step | None:
        """Solve a QP that is set up, as daqp's flag says, with bounds and at clearances."""
        if flag < 0:
            return None
        step, cost, flag, info = qp.model.solve()
        if flag not in (1, 2) or not np.isfinite(step).all():
            return None
        keeps = lower.max() <= 1e-6 and upper.min() >= -1e-6
        keeps = keeps and value[1:].min() >= self.required - 1e-6
        found, limits = np.asarray(info["lam"]), 2 * step.size
        clearance = np.zeros_like(value)
        clearance[qp.near[:, 0], qp.near[:, 1]] = np.maximum(0.0, -found[limits:])
        gain = -cost if keeps else math.inf
        return _Step(np.asarray(step).reshape(-1, 2), gain, found[:limits].copy(), clearance)

    def _first_order(
        self, problem: _Problem, states: NDArray[np.float64], controls: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the cost's gradient by the controls (2N,), the clearances (N+1, 2), their
        gradients (N+1, 2, 3), and what they lack of comfort (N+1, 2)."""
        c, io, n = self.config, self._io, self.stages
        io["z"][:, :4] = states
        io["z"][:n, 4:] = controls
        io["reference"][1:], _ = self._references(problem, states[1:])
        io["reference"][0] = 0.0
        io["multiplier"][:] = 0.0
        self._evaluate()
        value, normal = self._clearances(problem, states)
        lacking = np.maximum(0.0, self.required + c.comfort - value)
        lacking[0] = 0.0
        condense.add_closeness(io["gradient"], lacking, normal, c.closeness)
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
        lower, upper = constraints.bounds(
            states, controls, value, near, *self.driving, self.required, self.config.curvature_step
        )
        return lower, upper


def stop_controls(stages: int, braking: float, curvature: float) -> NDArray[np.float64]:
    """Brake as hard as the car can along one curvature: (stages, 2)."""
    return np.tile([-braking, curvature], (stages, 1))
