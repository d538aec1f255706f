"""A trial of a predictor: short drives with it, and what they say about its use."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foresee.infra.markdown import DASH, markdown
from foresee.mapping.conventions import TICK
from foresee.prediction import BadPredictionError, Caller, Prediction, Predictor, View
from planner.navigator import Navigator
from planner.navigator_config import NavigatorConfig
from predictor.extend import Extend
from predictor.recording.sample_set import DRIVES
from predictor.recording.settings import LEARNED
from predictor.scoring.scores import Scores, cell_rings
from sim import DubinsCar, Lidar
from sim.buildings import task_in_world
from sim.episode import EpisodeConfig, run_episode
from sim.families import generate
from sim.task import NoTaskError, Task
from sim.world import World

BUILDINGS = len(LEARNED)
"""Number of drives, each in a building of its own."""
SECONDS = 4.0
"""Length of a drive [s]."""
EVERY = 5
"""Ticks from one scored prediction to the next."""
RELIANCE = 0.05
"""Reliance ε of the drives. It is smaller than the default of `foresee corridor`, so that a broken
promise shows a cell in which the predictor was certain and wrong."""
MOST_BROKEN, TOO_MANY_BROKEN = 2 * RELIANCE, 5 * RELIANCE
"""Shares of broken promises above which the trial warns, and above which the predictor fails. A
calibrated one breaks about a share of ε; in so few drives it may well be twice as much."""
FEW = 20
"""Number of promises below which a predictor does not fail, because chance decides."""
MOST_OFF = 0.1
"""Calibration error of free above which the trial warns."""
SHARE_OF_TICK = 0.5
"""Share of a tick that a prediction may take; the rest is for the planner."""


@dataclass(eq=False)
class Trial:
    """What was measured in the drives of a trial.

    Cells are counted that were not observed, and for which the predictor has a confidence above 0.

    Attributes:
        own: scores of the predictor.
        extend: scores of the predictor `extend` in the same cells.
        promises: number of ticks in which the plan relied on unobserved cells.
        broken: number of these ticks in which such a cell was in fact not free.
        trusted: number of cells with a trust of at least 1 − ε, so that a plan may enter them.
        blocked: number of these cells that are not free.
        times: processor time of each prediction [s]; the first of each drive is left out.
    """

    own: Scores = field(default_factory=Scores)
    extend: Scores = field(default_factory=Scores)
    promises: int = 0
    broken: int = 0
    trusted: int = 0
    blocked: int = 0
    times: list[float] = field(default_factory=list)

    @property
    def share_free(self) -> float:
        """Share of the counted cells that are free; NaN if there are none."""
        return float(self._counts[1] / self._counts.sum()) if self._counts.sum() else np.nan

    @property
    def _counts(self) -> NDArray[np.int64]:
        """Number of the counted cells that are not free, and that are, (2,)."""
        return np.asarray(self.own.free.sum(axis=(0, 1)))

    def add(self, view: View, answer: Prediction, world: World) -> None:
        """Score a prediction.

        Args:
            view: what was observed.
            answer: the prediction.
            world: building in which it was observed.
        """
        free, occupied = world.truth(view.known.frame)
        counted = np.where(answer.confidence > 0.0, cell_rings(view.known), np.int8(-1))
        self.own.add(answer.p_free, answer.p_occupied, free, occupied, counted)
        lines = Extend().predict(view)
        self.extend.add(lines.p_free, lines.p_occupied, free, occupied, counted)
        enough = answer.confidence * answer.p_free >= 1.0 - RELIANCE
        trusted = (counted >= 0) & enough
        self.trusted += int(trusted.sum())
        self.blocked += int((trusted & ~free).sum())

    def table(self, name: str) -> str:
        """Return the measures as a table in Markdown; `name` is that of the predictor."""
        own, extend, rate = self.own.measures(), self.extend.measures(), self.share_free
        constant = {"brier_free": rate * (1.0 - rate), "ece_free": 0.0 * rate}
        rows = [["", name, "extend", f"constant {_text(rate, '.2f')}"]]
        for label, key in (
            ("Brier score of p_free", "brier_free"),
            ("calibration error of p_free", "ece_free"),
        ):
            rows.append([label, *(_text(of[key], ".3f") for of in (own, extend, constant))])
        times = " / ".join(f"{1e3 * value:.1f}" for value in np.percentile(self.times, [50, 99]))
        rows += [
            ["trusted cells that are not free", _share(self.blocked, self.trusted), "", ""],
            ["promises broken", _share(self.broken, self.promises), "", ""],
            ["processor time, p50 / p99 [ms]", times, "", ""],
        ]
        return markdown(rows)

    def errors(self) -> list[str]:
        """Return why the predictor should not be driven with, one line each with the remedy."""
        return [self._promises()] if self._fails else []

    def warnings(self) -> list[str]:
        """Return what should be better, one line each with the remedy."""
        lines = []
        if self.broken > MOST_BROKEN * self.promises and not self._fails:
            lines.append(self._promises())
        if self.promises == 0:
            lines.append(
                f"it makes no promises: confidence · p_free does not reach {1 - RELIANCE:g} where "
                f"a plan could lead, so at a reliance of {RELIANCE:g} it influences the route "
                "alone; raise the confidence in cells that are almost always free"
            )
        own, rate = self.own.measures(), self.share_free
        constant = rate * (1.0 - rate)
        if own["brier_free"] >= constant:
            lines.append(
                f"p_free is no better than a constant: its Brier score is {own['brier_free']:.3f}, "
                f"and {constant:.3f} if p_free is {rate:.2f} in each cell, the share that is free; "
                "return that share where you know no better"
            )
        if own["ece_free"] > MOST_OFF:
            said, true, _ = (bins[self._worst_bin] for bins in self.own.reliability("free"))
            lines.append(
                f"p_free is off by {own['ece_free']:.2f} on average: of the cells with a p_free of "
                f"about {said:.2f}, {_share(true, 1.0)} are free; return the share that is free"
            )
        slow = float(np.percentile(self.times, 99))
        if slow > SHARE_OF_TICK * TICK:
            lines.append(
                f"a prediction takes up to {1e3 * slow:.0f} ms of processor time, more than "
                f"{100 * SHARE_OF_TICK:g} % of a tick: on a robot, it is often late; make it "
                "faster, or the square smaller (--expansion)"
            )
        return lines

    @property
    def _fails(self) -> bool:
        """Whether too many promises were broken."""
        return self.promises >= FEW and self.broken > TOO_MANY_BROKEN * self.promises

    @property
    def _worst_bin(self) -> int:
        """Number of the bin of p_free that adds most to the calibration error."""
        said, true, weight = self.own.reliability("free")
        return int(np.nanargmax(weight * abs(said - true)))

    def _promises(self) -> str:
        """Return a line about broken promises."""
        return (
            f"it broke {self.broken} of {self.promises} promises: these plans led through "
            "unobserved cells of which one was not free, so that the car had to brake hard; "
            f"{_share(self.blocked, self.trusted)} of the cells that it trusts (confidence · "
            f"p_free of at least {1 - RELIANCE:g}) are not free: lower the confidence until at "
            f"most {100 * RELIANCE:g} % are not; look first at cells behind walls"
        )


def tasks() -> Iterator[Task]:
    """Yield `BUILDINGS` tasks in buildings of the kinds that networks are trained on.

    The buildings are held out from each training, see `predictor.recording.sample_set.DRIVES`.
    """
    found = 0
    for number in itertools.count():
        seed = DRIVES["validation"] + number
        try:
            task = task_in_world(generate(LEARNED[number % len(LEARNED)], seed), seed)
        except NoTaskError:
            continue
        yield task
        found += 1
        if found == BUILDINGS:
            return


def tried(predictor: Predictor, done: Callable[[], Any]) -> Trial:
    """Drive with a predictor for `SECONDS` in each of some buildings.

    Args:
        predictor: predictor to try. It takes part as in the arm `predicted`, on a free route.
        done: called after each drive.

    Raises:
        BadPredictionError: if the predictor breaks the contract in a drive.
    """
    trial = Trial()
    for task in tasks():
        _drive(task, predictor, trial)
        done()
    return trial


class _Watched:
    """A predictor that is watched in a drive.

    Attributes:
        answers: each `EVERY`-th view, and the answer to it.
        times: processor time of each answer [s].
        failure: the first error that it raised, or None.
    """

    def __init__(self, predictor: Predictor) -> None:
        self._caller = Caller(predictor)
        self.context_side, self.side = self._caller.context_side, self._caller.side
        self.answers: list[tuple[View, Prediction]] = []
        self.times: list[float] = []
        self.failure: BadPredictionError | None = None

    def predict(self, view: View) -> Prediction:
        """Return the answer of the predictor."""
        started = time.process_time()
        try:
            answer = self._caller.ask(view)
        except BadPredictionError as error:
            self.failure = self.failure or error
            raise
        # Of all threads, so that other processes do not count, nor the number of cores.
        self.times.append(time.process_time() - started)
        if (len(self.times) - 1) % EVERY == 0:
            self.answers.append((view, answer))
        return answer


def _drive(task: Task, predictor: Predictor, trial: Trial) -> None:
    """Drive once, and add what was measured to a trial."""
    watched, car = _Watched(predictor), DubinsCar()
    config = NavigatorConfig(
        reliance=RELIANCE,
        steer=True,
        start_margin=min(NavigatorConfig.start_margin, task.start_margin(car.limits.body)),
        # A long one, so that the trial does not depend on the load of the machine.
        deadline=600.0,
    )
    start, known = np.array(task.start), task.blank(config.window)
    navigator = Navigator(config, watched, start, task.goal, known, seed=task.seed)
    rng = np.random.default_rng([task.seed, 2])
    limit = EpisodeConfig(time_limit=SECONDS)
    kept = run_episode(task, navigator, car, Lidar(), limit, rng).trace["kept"]
    if watched.failure is not None:
        raise watched.failure
    trial.promises += int((kept >= 0).sum())
    trial.broken += int((kept == 0).sum())
    # The first one may have compiled code.
    trial.times += watched.times[1:]
    for view, answer in watched.answers:
        trial.add(view, answer, task.world)


def _share(part: float, whole: float) -> str:
    return f"{100 * part / whole:.0f} %" if whole else DASH


def _text(value: float, form: str) -> str:
    return DASH if np.isnan(value) else f"{value:{form}}"
