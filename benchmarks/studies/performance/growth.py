"""The growth of the stages' times with the sizes of sensor, map, window and horizon."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.studies.performance import sized_maps as places
from benchmarks.studies.performance.stage_times import closed_loop, spread, timed
from foresee.infra.drawing import new_figure
from foresee.prediction import View
from planner.navigator import NavigatorConfig
from planner.risk.risk_map import RiskMap
from predictor.recording.replay import replayed_with
from predictor.registry import load_predictor
from sim import Lidar, LidarConfig
from sim.buildings import task_in
from sim.task import Task
from sim.world import World

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BEAMS = (180, 360, 720, 1081, 2160, 4320)
MAP_SIDES = (500, 1000, 2000, 4000, 8000)
WINDOWS = (5.0, 10.0, 20.0, 40.0)
EXPANSIONS = (1.0, 1.25, 1.5, 1.75, 2.0)
HORIZONS = (20, 30, 40, 60)
WINDOW_AXIS = "window [m]\n(the predicted square is 13.7 m at most)"
AXES = ("beams", "map side [cells]", WINDOW_AXIS, "expansion", "horizon N")
REPEATS = 200
"""Number of timed calls of each stage."""

Times = dict[str, dict[str, float]]
"""Stage → its times, as `timing.spread` returns them."""


def grown(axis: str, seed: int, report: Callable[[str], None]) -> list[dict[str, Any]]:
    """Time the stages that depend on an axis, at each value of the axis.

    Args:
        axis: one of `AXES`.
        seed: seed of the buildings.
        report: function that shows what is being measured.

    Returns:
        For each value: `value`, and stage → times.
    """
    task = task_in("corridor", seed)
    measures: dict[str, tuple[tuple[float, ...], Callable[[Any], Times]]] = {
        "beams": (BEAMS, lambda beams: _sensing(task, beams)),
        "map side [cells]": (MAP_SIDES, lambda side: _casting(places.cluttered(side, seed))),
        WINDOW_AXIS: (WINDOWS, lambda window: believing(task, window, 2.0)),
        "expansion": (EXPANSIONS, lambda expansion: believing(task, 5.0, expansion)),
        "horizon N": (HORIZONS, lambda stages: _planning(stages, seed)),
    }
    values, measure = measures[axis]
    entries = []
    for value in values:
        report(f"{axis.splitlines()[0]}: {value:g}")
        entries.append({"value": value, **measure(value)})
    return entries


def _sensing(task: Task, beams: int) -> Times:
    lidar, poses = Lidar(LidarConfig(beams=beams)), places.along(task, REPEATS)
    near, far = task.blank(5.0), task.blank(40.0)
    scans = [lidar.scan(task.world, pose) for pose in poses]
    return {
        "scan": timed(lambda i: lidar.scan(task.world, poses[i]), REPEATS),
        "integrate, window 5 m": timed(lambda i: near.integrate(scans[i], poses[i]), REPEATS),
        "integrate, window 40 m": timed(lambda i: far.integrate(scans[i], poses[i]), REPEATS),
    }


def _casting(world: World) -> Times:
    lidar, poses = Lidar(), places.anywhere(world, REPEATS)
    return {"scan": timed(lambda i: lidar.scan(world, poses[i]), REPEATS)}


def _planning(stages: int, seed: int) -> Times:
    # The top speed whose full stop, plus half a second, takes as long as the horizon.
    times = closed_loop("known", 1, seed, v_max=(stages - 5.5) * 0.1 * 1.5)
    return {"mpc": spread(times["mpc"])}


def believing(task: Task, window: float, expansion: float) -> Times:
    """Time the steps from the observed map to the risk map, along a task's route.

    Args:
        task: building and route.
        window: side of the square in which the LIDAR is used [m].
        expansion: width of the predicted square divided by that of the window.
    """
    config = NavigatorConfig(window=window, expansion=expansion, reliance=0.05)
    poses = np.column_stack([places.along(task, REPEATS), np.zeros(REPEATS)])
    rng = np.random.default_rng(0)
    (*_, (known, _)) = replayed_with(task, poses, window, LidarConfig(), rng, 1)
    squares = [known.frame.square(x, y, config.predicted_side) for x, y in poses[:, :2]]
    crops = [known.crop(square) for square in squares]
    predictor = load_predictor("compact")
    views = [View(crop, pose[:3]) for crop, pose in zip(crops, poses, strict=True)]
    beliefs = [predictor.predict(view) for view in views]
    near = [known.crop(known.frame.square(x, y, config.risk_side)) for x, y in poses[:, :2]]

    def risk(i: int) -> RiskMap:
        return RiskMap.from_prediction(near[i], beliefs[i], config.reliance)

    return {
        "crop": timed(lambda i: known.crop(squares[i]), REPEATS),
        "predict": timed(lambda i: predictor.predict(views[i]), REPEATS),
        "risk": timed(risk, REPEATS),
    }


def draw(measured: dict[str, list[dict[str, Any]]]) -> Figure:
    """Draw a panel for each axis: medians as lines, shaded up to the 99th percentile."""
    figure = new_figure(13.0, 3.2)
    axes = figure.subplots(1, len(measured))
    for ax, (axis, entries) in zip(axes, measured.items(), strict=True):
        values = [entry["value"] for entry in entries]
        for name in entries[0]:
            if name == "value":
                continue
            median, tail = ([e[name][key] for e in entries] for key in ("median_ms", "p99_ms"))
            (line,) = ax.plot(values, median, marker="o", markersize=3, label=name)
            ax.fill_between(values, median, tail, color=line.get_color(), alpha=0.15, linewidth=0)
        ax.set_xlabel(axis)
        if values[-1] > 8 * values[0]:
            ax.set_xscale("log")
            ax.set_xticks(values, [str(value) for value in values], fontsize=7)
            ax.minorticks_off()
        ax.set_ylim(bottom=0)
        ax.legend(fontsize=7, frameon=False)
    axes[0].set_ylabel("time [ms], to the 99th percentile")
    return figure
