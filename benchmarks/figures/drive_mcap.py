"""A saved drive as an MCAP file, which Foxglove shows like the replay of a robot's log.

Scans and predictions are not saved. They are made again, from the saved states and the true map, as
the drive made them; nothing is planned or driven again. The plans are the saved ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from benchmarks.figures.animation import roll_out
from benchmarks.figures.file_name import file_name
from benchmarks.runs.arms import ARMS, Arm, arm_kind
from benchmarks.runs.driver import navigator_config, predictor_for
from benchmarks.runs.saved_run import Run
from benchmarks.runs.settings import Settings
from benchmarks.runs.tasks import limit_speed
from benchmarks.runs.trace import RunError, Trace
from foresee.infra.atomic_file import write_whole
from foresee.infra.environment import commit
from foresee.infra.progress import progress
from foresee.mapping.grid import OccupancyGrid
from foresee.prediction import Caller, Prediction, View
from planner.navigator_config import NavigatorConfig
from predictor.data.foxglove_layout import ENDING, foxglove_layout
from predictor.data.mcap_file import ROBOT, McapFile, writing_mcap
from sim import Lidar, LidarConfig
from sim.recorder import see
from sim.task import Rules, Task
from sim.world import World

NEAR = 2.0 / 255.0
"""Largest difference between a prediction and the saved one, which is rounded to 1/255."""


def write_drive(
    run: Run, folder: Path, index: int | None = None, arm: str | None = None
) -> list[Path]:
    """Write drive-INDEX-ARM.mcap and a layout, with a progress bar, and return their paths.

    Args:
        run: run that contains the drive.
        folder: folder for the files.
        index: number of the episode; None: the first in which all arms reached the goal.
        arm: arm that drove; None: one that uses a prediction.

    Raises:
        RunError: if there is no such drive, its trace is broken, or what is made again differs from
            what was saved.
        PredictorError: if its predictor cannot be loaded.
        BadPredictionError: if its predictor raises, or breaks its contract.
        McapError: if the file cannot be written, as without rosbags.
    """
    drive = _Drive.of(run, run.showcase if index is None else index, arm)
    path = folder / file_name("drive", "mcap", drive.trace.index, drive.trace.arm)
    about = run.settings | {"episode": drive.trace.index, "arm": drive.trace.arm}
    with writing_mcap(path, {"foresee": about | {"commit": commit()}}) as file:
        drive.write(file, path.name)
    layout = path.with_suffix(ENDING)
    write_whole(layout, foxglove_layout().encode())
    return [path, layout]


@dataclass(frozen=True, eq=False)
class _Drive:
    """A saved drive, and what its scans and predictions are made with.

    Attributes:
        run: run that contains the drive.
        trace: saved arrays.
        settings: settings of the run, with the top speed that the task allows.
        arm: arm that drove.
        task: task of the drive.
        config: settings of the arm's navigator.
    """

    run: Run
    trace: Trace
    settings: Settings
    arm: Arm
    task: Task
    config: NavigatorConfig

    @classmethod
    def of(cls, run: Run, index: int, arm_name: str | None) -> _Drive:
        """Return a drive of a run; of no `arm_name`, that of an arm that uses a prediction."""
        name = run.pick_arm(index, arm_name)
        if arm_kind(name) not in ARMS:
            raise RunError(f"{run.directory}: no arm is called {name!r} any more")
        trace, result, arm = run.trace(index, name), run.drives[index, name], ARMS[arm_kind(name)]
        rules = Rules(top_speed=result.top_speed)
        settings = limit_speed(Settings.of_saved(run.settings), [rules])
        if max(settings.pose_error, settings.yaw_error, settings.jitter, settings.missed) > 0.0:
            raise RunError(
                f"{run.directory}: the estimated poses of drives with --pose-error, --yaw-error, "
                "--jitter or --missed are not saved; only drives without them can be exported"
            )
        if result.late_ticks:
            raise RunError(
                f"{run.directory}: {result.late_ticks} ticks of this drive with --real-time were "
                "late, and it is not saved which; only drives without late ticks can be exported"
            )
        x, y, yaw = result.start
        goal = (result.goal[0], result.goal[1])
        world = World(result.world, trace.truth)
        task = Task(world, (x, y, yaw), goal, trace.waypoints, result.shortest, result.seed, rules)
        config = navigator_config(settings, arm)
        return cls(run, trace, settings, arm, task, config)

    def write(self, file: McapFile, name: str) -> None:
        """Write the drive; times start at one tick, since ROS takes 0 for no time.

        Args:
            file: file to write.
            name: name of the file, for the progress bar.
        """
        trace, dt, body = self.trace, self.run.setting("dt"), self.config.car.body
        lidar = Lidar(LidarConfig(range_noise=self.settings.noise, dropout=self.settings.dropout))
        bounds = self.config.bounds
        # As in the drive.
        rng = np.random.default_rng([self.task.seed, 2])
        caller = self._caller()
        known, first_seen = self._blank(), np.zeros_like(trace.first_seen, dtype=np.int32)
        file.mount(dt, lidar.config.mount)
        for tick, state in enumerate(progress(trace.states[:-1], desc=name, unit="tick")):
            time = dt * (tick + 1)
            scan = lidar.scan(self.task.world, state, rng)
            known.integrate(scan, state, bounds)
            known.mark_under(state, body, bounds)
            see(first_seen, trace.truth.frame, tick, state, known)
            file.place(time, state, ROBOT)
            file.scan(time, scan)
            file.observed(time, known)
            if caller is not None:
                side = caller.side or self.config.predicted_side
                prediction = caller.ask(View.of(known, state[:3], side, caller.context_side))
                self._compare(tick, prediction)
                file.predicted(time, prediction)
            file.plan(time, roll_out(state, trace.plans[tick], dt, trace.gears[tick]))
        file.place(dt * len(trace.states), trace.states[-1], ROBOT)
        if not np.array_equal(first_seen, trace.first_seen):
            self._refuse("the observed map", _first_difference(first_seen, trace.first_seen))

    def _caller(self) -> Caller | None:
        """Return what asks the predictor of the drive; None: the navigator did not ask any."""
        predictor = predictor_for(self.settings, self.arm, self.task)
        asked = self.config.reliance > 0.0 or self.config.steer
        return Caller(predictor) if asked and predictor is not None else None

    def _blank(self) -> OccupancyGrid:
        """Return the map at the start of the drive."""
        window, car = self.settings.window, self.config.car
        if self.arm.whole_map:
            known = OccupancyGrid.from_grid(self.trace.truth, window)
        else:
            known = self.task.blank(window)
        margin = min(self.config.start_margin, self.task.start_margin(car.body))
        known.mark_free(self.task.start, car.body, margin)
        return known

    def _compare(self, tick: int, prediction: Prediction) -> None:
        """Compare a prediction with the one that was saved, if it is of this tick.

        Raises:
            RunError: if they differ.
        """
        if "moment_p_free" not in self.trace or int(self.trace.read("moment_tick")) != tick:
            return
        moment = self.trace.moment
        made = np.stack([prediction.p_free, prediction.p_occupied, prediction.confidence])
        saved = np.stack(moment.prediction or [])
        if prediction.frame != moment.frame or np.abs(made - saved).max() > NEAR:
            self._refuse("the prediction", tick)

    def _refuse(self, what: str, tick: int) -> NoReturn:
        raise RunError(
            f"{self.run.directory}: {what} of tick {tick} of {self.trace.arm} in episode "
            f"{self.trace.index} differs from what was saved: the drive is of other code or weights"
        )


def _first_difference(made: NDArray[np.integer], saved: NDArray[np.integer]) -> int:
    """Return the first tick, from 0, in which two unequal arrays `first_seen` differ."""
    ticks = np.concatenate([made[made != saved], saved[made != saved]])
    return int(ticks[ticks > 0].min()) - 1
