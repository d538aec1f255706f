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
ONWARD_SPEED = 0.2
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

    def filter(self, state: NDArray[np.float64], plan: Plan, risk: RiskMap) -> tuple[Plan, bool]:
        """Slow a plan's first step down, as far as is needed for a last resort to remain after it.

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
        manoeuvres, curvature = self.manoeuvres(plan), plan.controls[0, 1]
        accelerations = np.linspace(plan.controls[0, 0], -braking, ACCELERATIONS)
        firsts = np.column_stack([accelerations, np.full(ACCELERATIONS, curvature)])
        fastest = None
        if state[3] > ONWARD_SPEED:
            fastest = self._fastest(state, firsts, manoeuvres, risk, onward=True)
        if fastest is None:
            fastest = self._fastest(state, firsts, manoeuvres, risk, onward=False)
        if fastest is None:
            braked = self.brake(state, plan, risk)
            return braked, checker.contact(braked, ~risk.certain, risk.frame) is None
        first, manoeuvre = fastest
        controls = np.vstack([firsts[first], manoeuvres[manoeuvre, 1:]])
        # Not clipped to the limits, so that the car goes on braking after its planned stop, in case
        # it arrives there faster.
        self.controls = shifted(controls, braking)
        return (plan if first == 0 else mpc.roll(state, controls)), True

    def _fastest(
        self,
        state: NDArray[np.float64],
        firsts: NDArray[np.float64],
        manoeuvres: NDArray[np.float64],
        risk: RiskMap,
        onward: bool,
    ) -> tuple[int, int] | None:
        """Find a large acceleration of the first step that leaves a manoeuvre to stop.

        Args:
            state: current x, y, yaw, v of the car, (4,).
            firsts: controls a, κ of the first step to try, by descending acceleration, (m, 2).
            manoeuvres: controls of the manoeuvres, (n, N, 2); their first steps are overwritten.
            risk: newest risk map around the car.
            onward: whether the car must be able to go on from the manoeuvre's end.

        Returns:
            Index of the first step, and of the manoeuvre; None if no first step leaves one.
        """
        scene = self.checker.body_in(~risk.certain, risk.frame)
        arcs, limits = self.checker.arcs_in(risk), self.mpc.limits.driving

        def after(first: int) -> int:
            """Return the index of a manoeuvre that remains after a first step, or -1."""
            manoeuvres[:, 0] = firsts[first]
            dt, spacing = self.mpc.config.dt, self.checker.spacing
            return int(first_free(state, manoeuvres, dt, limits, spacing, scene, onward, arcs))

        manoeuvre = after(0)
        if manoeuvre >= 0:
            return 0, manoeuvre
        too_fast, fastest = 0, len(firsts) - 1
        manoeuvre = after(fastest)
        while manoeuvre < 0 and not onward and too_fast < fastest - 1:
            # Gentler braking may leave a manoeuvre where harder braking leaves none.
            fastest -= 1
            manoeuvre = after(fastest)
        if manoeuvre < 0:
            return None
        # Bisection between an acceleration that is too high and one that leaves a manoeuvre.
        while fastest - too_fast > 1:
            middle = (fastest + too_fast) // 2
            candidate = after(middle)
            if candidate < 0:
                too_fast = middle
            else:
                fastest, manoeuvre = middle, candidate
        return fastest, manoeuvre

    def brake(self, state: NDArray[np.float64], plan: Plan, risk: RiskMap) -> Plan:
        """Return the least bad manoeuvre to stop, and keep its rest as the last resort."""
        manoeuvres = self.manoeuvres(plan)
        stops = [self.mpc.roll(state, controls) for controls in manoeuvres]
        badness = [self._badness(stop, risk) for stop in stops]
        best = badness.index(min(badness))
        self.controls = shifted(manoeuvres[best], self.mpc.limits.braking)
        return stops[best]

    def manoeuvres(self, plan: Plan) -> NDArray[np.float64]:
        """Return controls of manoeuvres to stop, (n, N, 2).

        They are the last resort of the last tick, braking along a plan, and swerves.
        """
        swerves = self._swerves.copy()
        np.copyto(swerves[:, :, 1], plan.controls[:, 1], where=np.isnan(swerves[:, :, 1]))
        return swerves if self.controls is None else np.concatenate([self.controls[None], swerves])

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
