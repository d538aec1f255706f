"""The last resort: at every tick, a way to stop inside what is certain."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.motion.contact import first_free, swerves
from planner.motion.plan import Plan
from planner.mpc.initial_guess import shifted
from planner.mpc.mpc import MPC
from planner.risk.risk_map import RiskMap
from planner.safety.collision import CONTACT_SPACING, CollisionChecker

ACCELERATIONS = 16
"""Number of accelerations, from the plan's own to hard braking, tried for the first step."""
SLOW = 0.2
"""Below this speed a last resort need not lead on: the car is about to stop anyway, and must not
stay at rest because of this rule [m/s]."""


class LastResort:
    """Ensures that the car can stop inside what is certain, however wrong the rest is.

    A plan relies on predictions at the reliance ε. After its first step the next scan may show that
    they are wrong; then some way to brake and swerve must still lie in what is certain. At the
    level λ = 0 only observed cells are certain, and by induction there always is one: the rest of
    the last tick's. Above it, predictions are certain, too. Then there may be none, because a
    prediction was wrong, has changed, or the level has fallen, and the car may collide. If
    possible, it is a way from whose end the car can go on, since a car that cannot reverse may
    otherwise stop in a corner for good.

    Args:
        mpc: rolls plans out, and knows the car's limits.
        checker: tests plans.
    """

    def __init__(self, mpc: MPC, checker: CollisionChecker) -> None:
        self.mpc, self.checker = mpc, checker
        self.controls: NDArray[np.float64] | None = None
        """Controls of a way to stop from the next state on, (N, 2); None: none is needed."""
        self._swerves = swerves(mpc.stages, mpc.limits.braking, mpc.limits.max_curvature)

    def begin(self, state: NDArray[np.float64], plan: Plan, risk: RiskMap) -> tuple[Plan, bool]:
        """Return the plan, or one that begins more slowly and leaves a last resort.

        Returns:
            What to drive, and whether a last resort remains after its first step.
        """
        mpc, checker, braking = self.mpc, self.checker, self.mpc.limits.braking
        if risk.certain is risk.safe:
            self.controls = None
            return plan, True
        if checker.contact(plan, ~risk.certain, risk.frame) is None:
            self.controls = shifted(plan.controls, braking)
            return plan, True
        ways, curvature = self.ways(plan), plan.controls[0, 1]
        accelerations = np.linspace(plan.controls[0, 0], -braking, ACCELERATIONS)
        found = None
        if state[3] > SLOW:
            found = self._fastest(state, accelerations, curvature, ways, risk, onward=True)
        if found is None:
            found = self._fastest(state, accelerations, curvature, ways, risk, onward=False)
        if found is None:
            braked = self.brake(state, plan, risk)
            return braked, checker.contact(braked, ~risk.certain, risk.frame) is None
        fastest, way = found
        controls = np.vstack([[[accelerations[fastest], curvature]], ways[way, 1:]])
        # Not clipped: the car goes on braking after its planned stop, in case it arrives faster.
        self.controls = shifted(controls, braking)
        return (plan if fastest == 0 else mpc.roll(state, controls)), True

    def _fastest(
        self,
        state: NDArray[np.float64],
        accelerations: NDArray[np.float64],
        curvature: float,
        ways: NDArray[np.float64],
        risk: RiskMap,
        onward: bool,
    ) -> tuple[int, int] | None:
        """Return the numbers of the first acceleration that leaves a way to stop, and of that way.

        The later accelerations brake harder. With `onward` the car must be able to go on from the
        way's end.
        """
        place = self.checker.body_in(~risk.certain, risk.frame)
        arcs = self.checker.arcs_in(risk)

        def way_after(level: int) -> int:
            first, driving = np.array([accelerations[level], curvature]), self.mpc.driving
            way = first_free(state, first, ways, driving, CONTACT_SPACING, place, onward, arcs)
            return int(way)

        way = way_after(0)
        if way >= 0:
            return 0, way
        too_fast, fastest = 0, ACCELERATIONS - 1
        way = way_after(fastest)
        while way < 0 and not onward and too_fast < fastest - 1:
            # A gentler beginning may leave a way where harder braking leaves none.
            fastest -= 1
            way = way_after(fastest)
        if way < 0:
            return None
        # By bisection.
        while fastest - too_fast > 1:
            middle = (fastest + too_fast) // 2
            found = way_after(middle)
            if found < 0:
                too_fast = middle
            else:
                fastest, way = middle, found
        return fastest, way

    def brake(self, state: NDArray[np.float64], plan: Plan, risk: RiskMap) -> Plan:
        """Brake as hard as the car can, on the way that meets what was seen most slowly."""
        ways = self.ways(plan)
        stops = [self.mpc.roll(state, way) for way in ways]
        badness = [self._badness(stop, risk) for stop in stops]
        best = badness.index(min(badness))
        self.controls = shifted(ways[best], self.mpc.limits.braking)
        return stops[best]

    def ways(self, plan: Plan) -> NDArray[np.float64]:
        """Return ways to stop (n, N, 2): the last one found, braking along a plan, and swerves."""
        ways = self._swerves.copy()
        np.copyto(ways[:, :, 1], plan.controls[:, 1], where=np.isnan(ways[:, :, 1]))
        return ways if self.controls is None else np.concatenate([self.controls[None], ways])

    def _badness(self, stop: Plan, risk: RiskMap) -> tuple[float, ...]:
        """Return the speeds at which a way meets occupied cells, leaves what is safe and what is
        certain, and ends."""
        met = (
            self.checker.contact(stop, blocked, risk.frame)
            for blocked in (risk.known.occupied, ~risk.safe, ~risk.certain)
        )
        hit, left, unsure = (0.0 if contact is None else contact[1] for contact in met)
        return hit, left, unsure, float(stop.states[-1, 3])
