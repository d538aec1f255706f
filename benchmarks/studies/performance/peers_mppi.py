"""Peer of the MPC: model-predictive path integral control by pytorch_mppi, on the same problem."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.performance.hall import BEHIND, MAP_CELLS, Solve, Solver, Tick
from foresee.mapping.conventions import RESOLUTION
from planner.mpc.mpc import MPC


@dataclass(frozen=True)
class MPPIConfig:
    """Settings of model-predictive path integral control.

    The defaults were the best of the settings tried in halls 1000 to 1004, which are not used for
    measurements: temperatures 10 to 0.01, spreads (0.5, 0.15) to (2, 0.6), 256 to 4096 samples, 1
    to 4 rounds, with and without clipping the samples before the dynamics do. The costs above those
    of our MPC (with guesses from the last plan and from three paths at every tick), summed over 60
    ticks in the five halls, were: 262 for 1024 samples at temperature 1 and spread (1, 0.3); at
    temperature 0.1, 27, and 16 in 4 rounds; at 0.03, 20; at 0.03 with 2048 samples 13, with 4096
    samples 17; with 2048 samples at 0.03 and spread (0.7, 0.2) 11.

    Attributes:
        samples: number of rollouts in a round.
        rounds: number of improvements of the controls in a tick.
        temperature: temperature λ of the method, in units of the cost.
        spread: standard deviation of acceleration [m/s²] and curvature [1/m] among the samples.
    """

    samples: int = 2048
    rounds: int = 1
    temperature: float = 0.03
    spread: tuple[float, float] = (0.7, 0.2)


def mppi(mpc: MPC, config: MPPIConfig | None = None) -> Solver:
    """Return pytorch_mppi as a solver, started from its shifted last controls.

    Samples cannot violate a limit of the car: the dynamics clip them, and keep the speed low enough
    to stop within the horizon. For speed, the cost is computed for all samples and stages at once,
    the map is interpolated bilinearly, and numbers have single precision.

    Args:
        mpc: MPC whose problem is solved.
        config: settings of the method; None: the defaults.
    """
    import torch
    from pytorch_mppi import MPPI
    from torch.nn.functional import grid_sample

    config = config or MPPIConfig()
    c, car, n, dt = mpc.config, mpc.limits, mpc.stages, mpc.config.dt
    lateral, offset = car.planned_cornering, car.body.length / 4
    speeds = [min(car.v_max, car.braking * dt * (n - k - 1)) for k in range(n)]
    now: dict[str, Any] = {}
    nothing = torch.zeros(config.samples)

    def step(z: Any, u: Any, k: int) -> Any:
        x, y, yaw, v = z[:, 0], z[:, 1], z[:, 2], z[:, 3]
        most = torch.clamp((speeds[k] - v) / dt, -car.braking, car.acceleration)
        a = torch.maximum(torch.minimum(u[:, 0], most), -v / dt)
        after = v + a * dt
        bound = torch.clamp(lateral / torch.maximum(v, after).square(), max=car.max_curvature)
        kappa = torch.maximum(torch.minimum(u[:, 1], bound), -bound)
        s = 0.5 * dt * (v + after)
        half = 0.5 * kappa * s
        chord = s * (1 - half.square() / 6)
        x, y = x + chord * torch.cos(yaw + half), y + chord * torch.sin(yaw + half)
        return torch.stack([x, y, yaw + 2 * half, after, a, kappa], 1)

    def cost(states: Any, _: Any) -> Any:
        x, y, yaw, _, a, kappa = states[0].unbind(-1)
        change = torch.diff(kappa, dim=1, prepend=now["last"].expand(config.samples, 1))
        ahead = torch.stack([torch.cos(yaw), torch.sin(yaw)], -1) * offset
        centre = torch.stack([x, y], -1)
        centres = torch.stack([centre + ahead, centre - ahead], -2)
        places = (centres - now["origin"]) / RESOLUTION - 0.5
        value = grid_sample(
            now["field"],
            (2.0 / (MAP_CELLS - 1) * places - 1.0).reshape(1, config.samples, -1, 2),
            mode="bilinear",
            padding_mode="border",
            align_corners=True,
        )[0, 0]
        total = -c.progress * (x + BEHIND) + 0.5 * c.contour * y.square()
        total += c.effort[0] * a.square() + c.effort[1] * kappa.square()
        total += c.smoothness * change.square()
        near = torch.clamp(mpc.required + c.comfort - value, min=0.0)
        broken = torch.clamp(mpc.required - value, min=0.0)
        end = 0.5 * (c.final[0] - c.contour) * y[:, -1].square()
        end += c.final[1] * (1 - torch.cos(yaw[:, -1]))
        clearance = 0.5 * c.closeness * near.square().sum(1)
        return total.sum(1) + end + clearance + c.violation * broken.sum(1)

    controller = MPPI(
        step,
        lambda z, u, k: nothing,
        6,
        torch.diag(torch.tensor(config.spread).square()),
        num_samples=config.samples,
        horizon=n,
        terminal_state_cost=cost,
        lambda_=config.temperature,
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
                for _ in range(config.rounds):
                    controller.command(start, shift_nominal_trajectory=False)
            return np.asarray(controller.U.numpy(), dtype=np.float64)

        return solve

    return prepare
