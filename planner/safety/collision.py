"""Collision check: sweep the body along a plan, and test it against every cell it must not enter.

A plan is used only after it has been tested here, whatever the solver reports.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.body import Body, Scene, covered
from foresee.mapping.car_limits import CONTACT_MARGIN, JUDGE_MARGIN, CarLimits
from foresee.mapping.grid import GridFrame
from foresee.mapping.kernels import njit
from planner.motion.path import POINT_SPACING, Path
from planner.motion.plan import Plan
from planner.mpc.initial_guess import LOOK
from planner.risk.risk_map import RiskMap
from planner.safety.contact import CONTACT_SPACING, Arcs, leads_on, plan_contact
from planner.safety.course import Course
from planner.safety.tube import EXACT, Tube

ONWARD_SHARES = np.array([0.0, 1.0, -1.0, 0.5, -0.5])
"""Curvatures of the arcs on which a car may go on from a plan's end, as shares of the tightest."""
ONWARD_MARGIN, ONWARD_SPACING = 0.05, 0.05
"""Margin around the body on these arcs, and distance between the poses tested on them [m]."""
COURSE_MARGIN, COURSE_SPACING = 0.02, 0.08
"""The same on a course [m]; the margin is that of paths, so that a path itself can be followed."""
COURSE_LENGTH, COURSE_NEAR = 4.0, 0.3
"""Length of a course that is tested, and distance from it at the end of this length [m]."""


@dataclass(frozen=True)
class CollisionChecker:
    """Tests plans for collisions.

    Attributes:
        car: limits and body of the car.
        dt: step of the plans [s].
        tube: how far the body may be from where a plan has it.
    """

    car: CarLimits
    dt: float
    tube: Tube = EXACT

    @property
    def spacing(self) -> float:
        """Distance between the poses at which a plan is tested [m]."""
        return min(CONTACT_SPACING, self.car.spacing(CONTACT_MARGIN - JUDGE_MARGIN))

    def is_safe(self, plan: Plan, risk: RiskMap) -> bool:
        """Return whether a plan ends stopped, with the body in the safe set all along it."""
        if not np.isfinite(plan.states).all() or plan.states[-1, 3] > 1e-3:
            return False
        return self.contact(plan, ~risk.safe, risk.frame) is None

    def contact(
        self, plan: Plan, blocked: NDArray[np.bool_], frame: GridFrame
    ) -> tuple[float, float] | None:
        """Find where and how fast the body first meets a blocked cell on a plan.

        Args:
            plan: plan to test.
            blocked: cells that the body must not enter, (rows, columns); those outside the frame
                are blocked, too.
            frame: position and resolution of the cells.

        Returns:
            Distance along the plan [m] and speed there [m/s], or None if it meets none.
        """
        scene = self.body_in(blocked, frame)
        along, speed = plan_contact(
            plan.states, plan.controls, self.dt, self.spacing, scene, self.tube
        )
        return None if along < 0.0 else (along, speed)

    def body_in(self, blocked: NDArray[np.bool_], frame: GridFrame) -> Scene:
        """Return blocked cells and the body, enlarged by a margin, for `planner.safety.contact`."""
        body = self.car.body.inflated(CONTACT_MARGIN)
        return Scene(blocked, *frame.lattice, *body.halves)

    def arcs_in(self, barred: NDArray[np.bool_], frame: GridFrame) -> Arcs:
        """Return the arcs on which the car may go on, and the barred cells, which it must avoid."""
        car = self.car
        scene = Scene(barred, *frame.lattice, *car.body.inflated(ONWARD_MARGIN).halves)
        return Arcs(
            ONWARD_SHARES * car.max_curvature, 2.0 * car.turning_radius, ONWARD_SPACING, scene
        )

    def course_on(self, path: Path, segment: int, risk: RiskMap) -> Course:
        """Return a path as the course of the car, and the barred cells, which it must avoid.

        Args:
            path: path to follow.
            segment: index of the path's segment near which the car is.
            risk: risk map around the car.
        """
        car = self.car
        scene = Scene(risk.barred, *risk.frame.lattice, *car.body.inflated(COURSE_MARGIN).halves)
        reach = round((car.stopping_distance + 2.0) / POINT_SPACING)
        return Course(
            path.points,
            segment,
            reach,
            LOOK,
            car.max_curvature,
            COURSE_LENGTH,
            COURSE_NEAR,
            COURSE_SPACING,
            scene,
        )

    def leads_on(
        self, pose: NDArray[np.float64], barred: NDArray[np.bool_], frame: GridFrame
    ) -> bool:
        """Return whether the body meets no barred cell on some arc from a pose (x, y, yaw, …)."""
        return bool(leads_on(pose, self.arcs_in(barred, frame)))


def swept_cells(
    plan: Plan, dt: float, body: Body, frame: GridFrame, among: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return rows and columns of the cells in the mask `among` that a body sweeps on a plan."""
    poses = plan.poses(dt, 2 * frame.resolution)
    rows, cols = np.nonzero(_sweep(among, *frame.lattice, poses, *body.halves))
    return rows, cols


@njit(cache=True, nogil=True)
def _sweep(among, resolution, origin, poses, half_length, half_width):  # type: ignore[no-untyped-def]
    met = np.zeros(among.shape, dtype=np.bool_)
    for i in range(poses.shape[0]):
        x, y, yaw = poses[i, 0], poses[i, 1], poses[i, 2]
        cells = covered(among.shape, resolution, origin, x, y, yaw, half_length, half_width)
        for j in range(cells.shape[0]):
            row, col = cells[j, 0], cells[j, 1]
            if among[row, col]:
                met[row, col] = True
    return met
