"""Peer of the MPC: model-predictive path integral control by pytorch_mppi, on the same problem.

The settings were the best of those tried in halls 1000 to 1004, which are not used for
measurements: temperatures 10 to 0.01, spreads (0.5, 0.15) to (2, 0.6), 256 to 4096 samples, 1 to 4
rounds of sampling in a tick, with and without clipping the samples before the dynamics do. The
costs above those of our MPC (with guesses from the last plan and from three paths at every tick),
summed over 60 ticks in the five halls, were: 262 for 1024 samples at temperature 1 and spread
(1, 0.3); at temperature 0.1, 27, and 16 in 4 rounds; at 0.03, 20; at 0.03 with 2048 samples 13,
with 4096 samples 17; with 2048 samples at 0.03 and spread (0.7, 0.2) 11.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn.functional import grid_sample

from benchmarks.studies.performance.hall import BEHIND, MAP_CELLS, Solve, Solver, Tick
from foresee.mapping.conventions import RESOLUTION
from planner.mpc.mpc import MPC

SAMPLES = 2048
"""Number of rollouts in a tick."""
TEMPERATURE = 0.03
"""Temperature λ of the method, in units of the cost."""
SPREAD = (0.7, 0.2)
"""Standard deviation of acceleration [m/s²] and curvature [1/m] among the samples."""


def mppi(mpc: MPC) -> Solver:
    """Return pytorch_mppi as a solver, started from its shifted last controls.

    Samples cannot violate a limit of the car: the dynamics clip them, and keep the speed low enough
    to stop within the horizon. For speed, the cost is computed for all samples and stages at once,
    the map is interpolated bilinearly, and numbers have single precision.

    Args:
        mpc: MPC whose problem is solved.
    """
    from pytorch_mppi import MPPI

    now: dict[str, Any] = {}
    nothing = torch.zeros(SAMPLES)
    controller = MPPI(
        lambda states, controls, stage: _step(mpc, states, controls, stage),
        lambda states, controls, stage: nothing,
        6,
        torch.diag(torch.tensor(SPREAD).square()),
        num_samples=SAMPLES,
        horizon=mpc.stages,
        terminal_state_cost=lambda states, controls: _cost(mpc, states[0], **now),
        lambda_=TEMPERATURE,
        step_dependent_dynamics=True,
    )

    def prepare(tick: Tick) -> Solve:
        if tick.is_first:
            torch.manual_seed(0)
        start = torch.tensor([*tick.state, 0.0, tick.last], dtype=torch.float32)
        now["last"] = start[5]
        now["origin"] = torch.tensor(tick.risk.frame.origin, dtype=torch.float32)
        now["field"] = torch.from_numpy(np.ascontiguousarray(tick.risk.clearance))[None, None]
        controller.U = torch.tensor(tick.guess, dtype=torch.float32)

        def solve() -> NDArray[np.float64]:
            with torch.inference_mode():
                controller.command(start, shift_nominal_trajectory=False)
            return np.asarray(controller.U.numpy(), dtype=np.float64)

        return solve

    return prepare


def _step(mpc: MPC, states: Any, controls: Any, stage: int) -> Any:
    """Return the next states (samples, 6): x, y, yaw, v, and the clipped control that led there."""
    car, dt = mpc.limits, mpc.config.dt
    x, y, yaw, v = states[:, 0], states[:, 1], states[:, 2], states[:, 3]
    top = min(car.v_max, car.braking * dt * (mpc.stages - stage - 1))
    most = torch.clamp((top - v) / dt, -car.braking, car.acceleration)
    a = torch.maximum(torch.minimum(controls[:, 0], most), -v / dt)
    after = v + a * dt
    bound = car.planned_cornering / torch.maximum(v, after).square()
    bound = torch.clamp(bound, max=car.max_curvature)
    kappa = torch.maximum(torch.minimum(controls[:, 1], bound), -bound)
    s = 0.5 * dt * (v + after)
    half = 0.5 * kappa * s
    chord = s * (1 - half.square() / 6)
    x, y = x + chord * torch.cos(yaw + half), y + chord * torch.sin(yaw + half)
    return torch.stack([x, y, yaw + 2 * half, after, a, kappa], 1)


def _cost(mpc: MPC, states: Any, last: Any, origin: Any, field: Any) -> Any:
    """Return the cost of each sample (samples,) from its states (samples, N, 6).

    Args:
        mpc: MPC whose problem is solved.
        states: states as `_step` returns them.
        last: curvature in the previous tick [1/m].
        origin: lower-left corner of the map, (2,) [m].
        field: clearance of each cell of the map, (1, 1, rows, columns) [m].
    """
    c = mpc.config
    x, y, yaw, _, a, kappa = states.unbind(-1)
    change = torch.diff(kappa, dim=1, prepend=last.expand(SAMPLES, 1))
    ahead = torch.stack([torch.cos(yaw), torch.sin(yaw)], -1) * mpc.limits.body.length / 4
    centre = torch.stack([x, y], -1)
    centres = torch.stack([centre + ahead, centre - ahead], -2)
    places = (centres - origin) / RESOLUTION - 0.5
    clearance = grid_sample(
        field,
        (2.0 / (MAP_CELLS - 1) * places - 1.0).reshape(1, SAMPLES, -1, 2),
        mode="bilinear",
        padding_mode="border",
        align_corners=True,
    )[0, 0]
    total = -c.progress * (x + BEHIND) + 0.5 * c.contour * y.square()
    total += c.effort[0] * a.square() + c.effort[1] * kappa.square()
    total += c.smoothness * change.square()
    near = torch.clamp(mpc.required + c.comfort - clearance, min=0.0)
    broken = torch.clamp(mpc.required - clearance, min=0.0)
    end = 0.5 * (c.final[0] - c.contour) * y[:, -1].square()
    end += c.final[1] * (1 - torch.cos(yaw[:, -1]))
    closeness = 0.5 * c.closeness * near.square().sum(1)
    return total.sum(1) + end + closeness + c.violation * broken.sum(1)
