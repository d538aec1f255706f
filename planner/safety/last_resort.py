"""The last resort: a manoeuvre that stops the car within certain cells, kept in every tick."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.motion.plan import Plan
from planner.mpc.initial_guess import shifted
from planner.mpc.mpc import MPC
from planner.risk.risk_map import RiskMap
from planner.safety.collision import CollisionChecker
from planner.safety.contact import first_free, swerves

ACCELERATIONS = 16
"""Number of accelerations, from the plan's own to full braking, tried for the first step."""
SLOW = 0.2
"""Speed below which the car need not be able to go on from the end of a last resort [m/s]: it is
about to stop anyway, and must not stay at rest because of this rule."""


class LastResort:
    """Ensures that the car can stop within certain cells (`RiskMap.certain`).

    A plan relies on predictions at the reliance ε. After its first step the next scan may show that
    they are wrong. Then the car must still be able to brake and swerve within certain cells. At the
    level λ = 0 only observed cells are certain, and such a manoeuvre always exists, by induction:
    the rest of the last tick's. At λ > 0 cells may also be certain by prediction. Then none may
    exist, because a prediction was wrong or has changed, or the level has fallen, and the car may
    collide. Manoeuvres from whose end the car can go on are preferred, since a car that cannot
    reverse may otherwise stop in a corner for good.

    Args:
        mpc: MPC, which simulates the manoeuvres and holds the car's limits.
        checker: collision checker, which tests them.
    """

    def __init__(self, mpc: MPC, checker: CollisionChecker) -> None:
        self.mpc, self.checker = mpc, checker
        self.controls: NDArray[np.float64] | None = None
        """Controls of the last resort from the next state on, (N, 2); None: none is needed."""
        self._swerves = swerves(mpc.stages, mpc.limits.braking, mpc.limits.max_curvature)

    def begin(self, state: NDArray[np.float64], plan: Plan, risk: RiskMap) -> tuple[Plan, bool]:
        """Return a plan, with its first step slowed down as far as a last resort requires it.

        Returns:
            Plan to drive, and whether a last resort remains after its first step.
        """
        mpc, checker, braking = self.mpc, self.checker, self.mpc.limits.braking
        if risk.plan_suffices:
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
        # Not clipped to the limits, so that the car goes on braking after its planned stop, in case
        # it arrives there faster.
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
        """Find a large acceleration of the first step that leaves a manoeuvre to stop.

        Args:
            state: current x, y, yaw, v of the car, (4,).
            accelerations: accelerations to try, in descending order [m/s²].
            curvature: curvature of the first step [1/m].
            ways: controls of the manoeuvres, (n, N, 2).
            risk: newest risk map around the car.
            onward: whether the car must be able to go on from the manoeuvre's end.

        Returns:
            Index of the acceleration, and of the manoeuvre; None if no acceleration leaves one.
        """
        place = self.checker.body_in(~risk.certain, risk.frame)
        arcs = self.checker.arcs_in(risk)

        def way_after(level: int) -> int:
            first, driving = np.array([accelerations[level], curvature]), self.mpc.driving
            way = first_free(state, first, ways, driving, self.checker.spacing, place, onward, arcs)
            return int(way)

        way = way_after(0)
        if way >= 0:
            return 0, way
        too_fast, fastest = 0, ACCELERATIONS - 1
        way = way_after(fastest)
        while way < 0 and not onward and too_fast < fastest - 1:
            # Gentler braking may leave a manoeuvre where harder braking leaves none.
            fastest -= 1
            way = way_after(fastest)
        if way < 0:
            return None
        # Bisection between an acceleration that is too high and one that leaves a manoeuvre.
        while fastest - too_fast > 1:
            middle = (fastest + too_fast) // 2
            found = way_after(middle)
            if found < 0:
                too_fast = middle
            else:
                fastest, way = middle, found
        return fastest, way

    def brake(self, state: NDArray[np.float64], plan: Plan, risk: RiskMap) -> Plan:
        """Return the least bad manoeuvre to stop, and keep its rest as the last resort."""
        ways = self.ways(plan)
        stops = [self.mpc.roll(state, way) for way in ways]
        badness = [self._badness(stop, risk) for stop in stops]
        best = badness.index(min(badness))
        self.controls = shifted(ways[best], self.mpc.limits.braking)
        return stops[best]

    def ways(self, plan: Plan) -> NDArray[np.float64]:
        """Return controls of manoeuvres to stop, (n, N, 2).

        They are the last resort of the last tick, braking along a plan, and swerves.
        """
        ways = self._swerves.copy()
        np.copyto(ways[:, :, 1], plan.controls[:, 1], where=np.isnan(ways[:, :, 1]))
        return ways if self.controls is None else np.concatenate([self.controls[None], ways])

    def _badness(self, stop: Plan, risk: RiskMap) -> tuple[float, ...]:
        """Return how bad a stop is, as speeds [m/s] of which the first ones matter most.

        They are the speeds at which the body meets cells observed occupied, leaves the safe set,
        leaves the certain cells, and reaches the plan's end.
        """
        met = (
            self.checker.contact(stop, blocked, risk.frame)
            for blocked in (risk.known.occupied, ~risk.safe, ~risk.certain)
        )
        hit, left, unsure = (0.0 if contact is None else contact[1] for contact in met)
        return hit, left, unsure, float(stop.states[-1, 3])
