"""The car's minimum-time problem on a known map, by direct multiple shooting.

The controls, acceleration and curvature, are constant in each tick. All ticks have the same
duration, which is an optimisation variable. A tick is modelled by the same arc as in the simulator,
so that `sim.car.DubinsCar` can drive the solution. casadi derives the problem, and IPOPT solves it
(Wächter and Biegler 2006). The solution is a local minimum, which depends on the first guess.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, spline_filter

from foresee.mapping.car_limits import CarLimits
from foresee.mapping.control import Control
from foresee.mapping.grid import GridFrame, paste
from sim.car import DubinsCar
from sim.task import Task

CIRCLES = 3
"""Number of circles that cover the body. Only the two at its ends are constrained, since they sweep
over what the others cover."""
PLACES_APART = 0.14
"""Approximate distance of the places along a tick where the circles are constrained [m]."""
MARGINS = (0.006, 0.012, 0.025)
"""Margins to add to the circles' radius [m], tried in this order as long as the solution collides
in the simulator. The first is a little more than the simulator grows the body by."""
CAP = 1.0
"""Clearance above which walls have no influence [m]."""
INSIDE = 1e-4
"""Distance inside the goal's radius at which a drive ends, against rounding [m]."""
AROUND = 3.0
"""Margin around the guesses within which the map is used [m]."""


@dataclass(frozen=True, eq=False)
class Guess:
    """A drive from which the solver starts; it need not be feasible.

    Attributes:
        name: name of the guess, which tells how it was made.
        dt: duration of a tick [s].
        states: x, y [m], yaw [rad], v [m/s], (N + 1, 4).
        controls: acceleration [m/s²], curvature [1/m], (N, 2).
    """

    name: str
    dt: float
    states: NDArray[np.float64]
    controls: NDArray[np.float64]

    @property
    def time(self) -> float:
        """Duration [s]."""
        return self.dt * len(self.controls)

    def resampled(self, ticks: int) -> Guess:
        """Return the same drive with another number of ticks."""
        starts, ends = np.linspace(0.0, 1.0, len(self.states)), np.linspace(0.0, 1.0, ticks + 1)
        states = np.stack([np.interp(ends, starts, column) for column in self.states.T], axis=1)
        held = ((ends[1:] + ends[:-1]) / 2 * len(self.controls)).astype(int)
        return Guess(self.name, self.time / ticks, states, self.controls[held])


@dataclass(frozen=True, eq=False)
class TimeOptimalDrive(Guess):
    """A drive that was rolled out with the simulator's car.

    Attributes:
        status: return status of the solver.
        collides: whether the body collided.
        arrives: whether the drive ended within the goal's radius.
    """

    status: str
    collides: bool
    arrives: bool

    @property
    def valid(self) -> bool:
        """Whether the rollout arrives without a collision; the solver's status does not count."""
        return self.arrives and not self.collides


@dataclass(frozen=True, eq=False)
class MinimumTime:
    """The minimum-time problem of a task.

    Attributes:
        task: building, start and goal.
        car: limits and body of the car.
        goal_radius: distance from the goal at which a drive ends, at any speed [m].
        box: lowest and highest x, y that a drive may use, (2, 2) [m].
    """

    task: Task
    car: CarLimits
    goal_radius: float
    box: NDArray[np.float64]

    def solve(self, guess: Guess, iterations: int, barrier: float = 0.1) -> TimeOptimalDrive:
        """Return the fastest drive near a guess, rolled out with the simulator's car.

        Args:
            guess: first guess; its number of ticks is kept.
            iterations: largest number of solver iterations for each margin.
            barrier: first barrier parameter of IPOPT; small if the guess is nearly a solution.
        """
        for margin in MARGINS:
            drive = self._solve(guess, margin, iterations, barrier)
            if not (drive.collides and drive.status == "Solve_Succeeded"):
                break
            guess, barrier = drive, 1e-3
        return drive

    def roll(self, guess: Guess, status: str = "") -> TimeOptimalDrive:
        """Roll out the controls of a guess with the simulator's car.

        Args:
            guess: drive whose controls are used.
            status: return status of the solver, for the result.
        """
        car, state = DubinsCar(self.car), np.array([*self.task.start, 0.0])
        states, hit = [state], False
        for control in (Control(*pair) for pair in guess.controls.tolist()):
            hit = hit or car.collides(self.task.world, state, control, guess.dt)
            state = car.step(state, control, guess.dt)
            states.append(state)
        arrives = math.dist(state[:2], self.task.goal) <= self.goal_radius
        driven = np.array(states)
        # The car's yaw is wrapped; unwrapped, it can be interpolated.
        driven[:, 2] = np.unwrap(driven[:, 2])
        return TimeOptimalDrive(guess.name, guess.dt, driven, guess.controls, status, hit, arrives)

    def _solve(
        self, guess: Guess, margin: float, iterations: int, barrier: float
    ) -> TimeOptimalDrive:
        car, ticks = self.car, len(guess.controls)
        places = max(1, math.ceil(car.v_max * guess.dt / PLACES_APART))
        x, u, dt = ca.MX.sym("x", 4, ticks + 1), ca.MX.sym("u", 2, ticks), ca.MX.sym("dt")
        stage = self._stage(places).map(ticks)
        after, lateral, clear = stage(x[:, :-1], u, ca.repmat(dt, 1, ticks))
        last = x[:2, ticks] - ca.DM(list(self.task.goal))
        # A little below the limit, since the simulator clips a curvature that exceeds it by
        # rounding, and the drive would then deviate from the solution.
        cornering = car.lateral_acceleration * (1.0 - 1e-6)
        # Each row is a constraint: values, lower bound, upper bound.
        rows = [
            (x[:, 1:] - after, 0.0, 0.0),
            (lateral, -cornering, cornering),
            (clear, self.car.body.circles(CIRCLES)[1] + margin, np.inf),
            (ca.sumsqr(last), 0.0, (self.goal_radius - INSIDE) ** 2),
        ]
        low, high = np.full((ticks + 1, 4), -np.inf), np.full((ticks + 1, 4), np.inf)
        low[:, :2], high[:, :2] = self.box
        low[:, 3], high[:, 3] = 0.0, car.v_max
        low[0] = high[0] = [*self.task.start, 0.0]
        hardest = np.tile([car.acceleration, car.max_curvature], ticks)
        softest = np.tile([-car.braking, -car.max_curvature], ticks)
        options: Any = {
            "print_time": False,
            "calc_lam_p": False,
            "ipopt": {
                "print_level": 0,
                "sb": "yes",
                "max_iter": iterations,
                "mu_init": barrier,
                "tol": 1e-6,
                "constr_viol_tol": 1e-7,
            },
        }
        problem: Any = {
            "x": ca.vertcat(dt, ca.vec(x), ca.vec(u)),
            "f": ticks * dt,
            "g": ca.vertcat(*[ca.vec(values) for values, _, _ in rows]),
        }
        solver = ca.nlpsol("solver", "ipopt", problem, options)
        solution = solver(
            x0=np.concatenate([[guess.dt], guess.states.ravel(), guess.controls.ravel()]),
            lbx=np.concatenate([[0.02 * guess.dt], low.ravel(), softest]),
            ubx=np.concatenate([[5.0 * guess.dt], high.ravel(), hardest]),
            lbg=np.concatenate([np.full(values.numel(), lowest) for values, lowest, _ in rows]),
            ubg=np.concatenate([np.full(values.numel(), highest) for values, _, highest in rows]),
        )
        values = np.array(solution["x"]).ravel()
        controls = values[-2 * ticks :].reshape(ticks, 2)
        drive = Guess(guess.name, float(values[0]), guess.states, controls)
        return self.roll(drive, solver.stats()["return_status"])

    def _stage(self, places: int) -> ca.Function:
        """Return the function of one tick from state (4,), control (2,) and duration.

        The function returns the state after the tick (4,), the lateral acceleration at both ends
        (2,), and the clearance of the circles' centres at some places along it (2 · places,).
        """
        # Scalar symbols (SX) are several times as fast as matrix symbols (MX), which splines need.
        x, u, dt = ca.SX.sym("x", 4), ca.SX.sym("u", 2), ca.SX.sym("dt")

        def after(t: Any) -> Any:
            length = x[3] * t + 0.5 * u[0] * t**2
            half = 0.5 * u[1] * length
            chord = length * (1 - half**2 / 6 + half**4 / 120 - half**6 / 5040)
            return ca.vertcat(
                x[0] + chord * ca.cos(x[2] + half),
                x[1] + chord * ca.sin(x[2] + half),
                x[2] + 2 * half,
                x[3] + u[0] * t,
            )

        offset = float(self.car.body.circles(CIRCLES)[0][-1])
        centres = []
        for place in range(1, places + 1):
            pose = after(dt * place / places)
            ahead = offset * ca.vertcat(ca.cos(pose[2]), ca.sin(pose[2]))
            centres += [pose[:2] + ahead, pose[:2] - ahead]
        end = after(dt)
        lateral = ca.vertcat(x[3] ** 2 * u[1], end[3] ** 2 * u[1])
        motion = ca.Function("motion", [x, u, dt], [end, lateral, ca.horzcat(*centres)])
        inputs = [ca.MX.sym("x", 4), ca.MX.sym("u", 2), ca.MX.sym("dt")]
        *outputs, at = motion(*inputs)
        clear = self._clearance.map(2 * places)(at).T
        return ca.Function("stage", inputs, [*outputs, clear])

    @cached_property
    def _clearance(self) -> ca.Function:
        """Cubic spline of the signed distance to walls: from a point (2,) [m] to a distance [m]."""
        frame = self.task.world.grid.frame
        first = np.floor((self.box[0] - frame.origin) / frame.resolution).astype(int) - 2
        last = np.ceil((self.box[1] - frame.origin) / frame.resolution).astype(int) + 2
        (col, row), (cols, rows) = first, last - first
        corner = frame.origin[0] + col * frame.resolution, frame.origin[1] + row * frame.resolution
        part = GridFrame(frame.resolution, corner, (int(rows), int(cols)))
        solid = paste(frame, self.task.world.solid, part, np.bool_(True))
        distance = frame.resolution * np.minimum(signed_distance(solid), CAP / frame.resolution)
        # Coefficient k belongs to sample k, in the middle of knots k to k + 4.
        knots = [
            (frame.origin[axis] + (start + np.arange(-1.5, count + 2.0)) * frame.resolution)
            for axis, start, count in ((0, col, cols), (1, row, rows))
        ]
        at = ca.MX.sym("at", 2)
        coefficients = ca.DM(spline_filter(distance, mode="mirror").ravel())
        spline = ca.bspline(at, coefficients, [k.tolist() for k in knots], [3, 3], 1, {})
        return ca.Function("clearance", [at], [spline])


def signed_distance(solid: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the signed distance of each cell's centre to the solid cells [cells]; negative inside.

    The distance is measured to the squares of the cells, not to their centres. It is computed on a
    lattice of half the spacing, which also contains the corners of cells and the middles of their
    sides: the nearest point of a square is always one of these.
    """
    doubled = np.pad(solid.repeat(2, axis=0).repeat(2, axis=1), 1)
    closed = doubled[:-1, :-1] | doubled[1:, :-1] | doubled[:-1, 1:] | doubled[1:, 1:]
    distance = distance_transform_edt(~closed) - distance_transform_edt(closed)
    return np.asarray(0.5 * distance[1::2, 1::2], dtype=np.float64)
