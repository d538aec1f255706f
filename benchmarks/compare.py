"""Comparisons from Python, without files: `drive` through a building, and `plot` the drives."""

from __future__ import annotations

from dataclasses import asdict, fields
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.calibration.certificate import at_risk
from benchmarks.calibration.settings import refuse_without_risk
from benchmarks.figures.speed_profile import speed_profile
from benchmarks.runs.drive import drive as drive_episode
from benchmarks.runs.saved_run import Run
from benchmarks.runs.settings import Settings
from benchmarks.runs.summary import summarise
from benchmarks.runs.tasks import make_task_in
from benchmarks.runs.warm_up import warm_up_if_cold
from foresee.infra.command_line import UsageError
from foresee.infra.drawing import own_style
from foresee.infra.float_errors import usual_float_errors
from foresee.mapping.conventions import TICK
from sim.buildings import building
from sim.world import World

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@usual_float_errors()
def drive(
    world: World | str, seed: int = 0, calibration: Path | None = None, **settings: Any
) -> Run:
    """Drive through a building with several arms, from the same start to the same goal.

    Args:
        world: building, name of a family of generated buildings, or path of a map_server file.
        seed: seed of start and goal, and of a generated building.
        calibration: calibration.json of `benchmarks.calibrate` for a `risk` above 0; None: the
            shipped one that is for the family that `world` names. A `World` cannot have one.
        settings: fields of `benchmarks.runs.settings.Settings`, such as `arms`, `predictor`,
            `risk`, `uncertified`, `reliance`, `v_max`, `vehicle`, `car`, `start` and
            `goal`; lists and arrays serve as tuples. `predictor` can also be a class, which is
            called without arguments for each arm.

    Returns:
        The drives: `episodes` holds a `DriveResult` for each arm, `trace(0, arm)` gives its arrays.

    Raises:
        MapError: if `world` is a string that names neither a family nor a readable map file.
        NoTaskError: if the building has no route of 10 m or more, or none from `start` to `goal`;
            if a drawn route is to be prescribed (`route="fixed"`), but passes a place twice.
        TaskFileError: if `start` or `goal` is not free.
        PredictorError: if the predictor cannot be loaded.
        CarFileError: if `car` cannot be read.
        UsageError: if a setting cannot be used, or no shipped calibration is for these drives; if
            `calibration` or `uncertified` is given without a `risk` above 0.
        CalibrationError: if the calibration is for other settings, or only for larger risks, or was
            made with drives in the same building.
    """
    settings = {name: _plain(value) for name, value in settings.items()}
    unknown = settings.keys() - ({field.name for field in fields(Settings)} - {"episodes"})
    if unknown:
        raise UsageError(f"{min(unknown)}: drive() has no such setting")
    if not isinstance(settings.get("risk", 0.0), Real):
        raise UsageError("risk: drive() takes one number")
    if "predictor" in settings:
        settings["predictor"] = _name_of(settings["predictor"])
    name = world if isinstance(world, str) else world.name
    chosen = Settings.with_defaults(world=(name,), seed=seed, episodes=1, **settings)
    if chosen.tasks is not None:
        raise UsageError("tasks: a file of tasks is driven by the command foresee corridor")
    refuse_without_risk((chosen.risk,), calibration, chosen.uncertified)
    if chosen.risk > 0 and not isinstance(world, str):
        raise UsageError(
            "risk: a calibration is for a family or a map file: pass the family's name or the "
            "file's path"
        )
    chosen = at_risk(chosen, calibration)
    place = building(world, seed) if isinstance(world, str) else world
    task = make_task_in(place, chosen)
    warm_up_if_cold()
    drives = [drive_episode(chosen, 0, arm, task) for arm in chosen.arms]
    results = [drive.result for drive in drives]
    saved, summary = asdict(chosen) | {"dt": TICK}, summarise(results, chosen.arms)
    arrays = {name: values for drive in drives for name, values in drive.trace.arrays.items()}
    return Run(Path(name), saved, summary, results, arrays)


def _plain(value: Any) -> Any:
    """Return lists and arrays as tuples of plain numbers, and other values as they are."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    return tuple(np.asarray(value).tolist()) if isinstance(value, list) else value


def _name_of(predictor: object) -> str:
    """Return the name by which `load_predictor` finds a predictor.

    Raises:
        UsageError: if it is neither a name nor a class of a module.
    """
    if isinstance(predictor, str):
        return predictor
    if isinstance(predictor, type) and "<locals>" not in predictor.__qualname__:
        return f"{predictor.__module__}:{predictor.__qualname__}"
    raise UsageError(
        "predictor: drive() takes a name, or a class that is not defined in a function, and no "
        f"{type(predictor).__name__}: each arm makes a predictor of its own"
    )


def plot(run: Run) -> Figure:
    """Draw the speed over the distance driven for each arm, and what limited the speed."""
    with own_style():
        return speed_profile([run])
