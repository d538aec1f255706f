"""The settings of a comparison."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from json import dumps, loads
from typing import Any, Self, get_type_hints

from benchmarks.runs.arms import ARMS, arm_kind
from foresee.infra.command_line import UsageError
from foresee.infra.options import Options, given, option
from foresee.infra.plain_json import fits
from foresee.mapping.car_file import PRESETS, CarFile
from foresee.mapping.conventions import LONGEST_STOP, NOISE_CUT
from foresee.mapping.error_bounds import ErrorBounds
from foresee.mapping.family_names import FAMILIES
from planner.revision import FIRST

FARTHEST = 1e6
"""Largest coordinate of a start or a goal [m]."""
VEHICLES = ("dubins", "reeds-shepp", "differential")
"""Kinds of cars: without and with a reverse gear, and one that also turns on the spot."""
REAL_DEADLINE = 0.05
"""Longest wait for a prediction on the wall clock, if none is given [s]."""
REVERSE = 0.5
"""Top speed in reverse of a car whose file does not give it [m/s]."""
TURN_RATE = 1.5
"""Yaw rate of turns on the spot of a car whose file does not give it [rad/s]."""


HEADINGS = {
    "tasks of your own": ("tasks", "start", "goal"),
    "the car": ("car", "vehicle", "v_max", "braking"),
    "what it sees and predicts": ("window", "expansion", "noise", "dropout", "frontiers"),
    "how far it relies on predictions": ("reliance", "uncertified", "level", "fixed_level"),
    "errors of the robot, and what the navigator is told of them": (
        *("delay", "jitter", "lag", "pose_error", "yaw_error", "missed"),
        *("told_delay", "told_jitter", "told_lag", "told_pose_error", "told_yaw_error"),
        "told_noise",
    ),
    "the wall clock": ("real_time", "deadline"),
}
"""Heading in the help → settings below it; the others are the general ones."""


def _arms(text: str) -> tuple[str, ...]:
    return tuple(ARMS) if text == "all" else tuple(text.split(","))


@dataclass(frozen=True)
class Settings(Options):
    """Settings that decide the results of a comparison; the help of each option describes it."""

    world: tuple[str, ...] = option(
        ("corridor",),
        f"buildings to drive in: families of generated ones ({', '.join(FAMILIES)}), map_server "
        ".yaml files, or folders of them; several are mixed",
        "W",
    )
    tasks: str | None = option(
        None,
        "JSON file with start, goal and rules of tasks in the maps of --world (default: tasks are "
        "drawn). The episodes are its tasks in order; after the last, the first follows again. "
        "Their top speed limits --v-max",
        "FILE",
    )
    start: tuple[float, float, float] | None = option(
        None,
        "x, y [m] and yaw [rad] at the start of one task, in the only building of --world; a "
        "generated building is that of --seed (default: tasks are drawn)",
        "X Y YAW",
        low=-FARTHEST,
        high=FARTHEST,
    )
    goal: tuple[float, float] | None = option(
        None,
        "x, y of the goal of the task that begins at --start [m]",
        "X Y",
        low=-FARTHEST,
        high=FARTHEST,
    )
    route: str = option(
        "free",
        "free: each arm finds its own way; fixed: all arms follow the same prescribed route",
        choices=("free", "fixed"),
    )
    episodes: int = option(
        12,
        "number of tasks; each arm drives all of them (default: 12, or 1 with --start)",
        "N",
        low=1,
        high=1_000_000,
    )
    seed: int = option(
        0, "seed of the first task; the next tasks use the seeds after it", "N", low=0, high=2**31
    )
    arms: tuple[str, ...] = option(
        ("known", "predicted", "oracle"),
        f"arms (variants) to compare, separated by commas: of {', '.join(ARMS)}; or all",
        "A,B",
        parse=_arms,
    )
    predictor: str = option(
        "compact",
        "none, extend, compact, a name that a package offers, module:Class, or weights that "
        "predictor.train has written, FILE.safetensors",
        "P",
    )
    frontiers: str = option(
        "learned",
        "predictor of frontiers of the arms that end with +frontiers: learned, the one of this "
        "package; or weights that predictor.train_frontiers has written, FILE.safetensors",
        "P",
    )
    risk: float = option(
        0.0,
        "accepted probability of a collision in a drive of arm predicted; 0: collisions are "
        "excluded by construction. Above 0, a calibration gives the level of its last resort",
        "RISK",
        low=0,
        high=1,
    )
    uncertified: bool = option(
        False,
        "drive at a --risk without a calibration for these drives, such as in real buildings: the "
        "level is that of --calibration, or of a shipped one for the same predictor and route "
        "in a mixture of families. More drives than accepted may collide",
    )
    level: float = option(
        0.0,
        "in place of --risk, without a certificate: the last resort of arm predicted may enter an "
        "unobserved cell if confidence · p_free is at least 1 − LEVEL / doubt, where the doubt is "
        "that of the predictor, usually 1; 0: none. If that proves wrong, the car may collide",
        "LEVEL",
        low=0,
        high=0.99,
    )
    fixed_level: bool = option(
        False, "do not lower the level of the last resort while predictions prove wrong"
    )
    reliance: float = option(
        0.3,
        "a plan may enter an unobserved cell if confidence · p_free is at least 1 − RELIANCE. If "
        "that proves wrong, the car brakes hard. It is raised to --level if it is smaller",
        "RELIANCE",
        low=0,
        high=1,
    )
    car: str | None = option(
        None,
        f"YAML file of a car, or {', '.join(PRESETS)}: its body and limits. --v-max, --braking and "
        "--vehicle override those of the file (default: the car of the published results)",
        "CAR",
    )
    v_max: float = option(4.0, "top speed [m/s]", "V", low=0.5, high=10)
    braking: float = option(1.5, "hardest braking [m/s²]", "A", low=0.3, high=10)
    window: float = option(
        5.0,
        "side of the square around the car in which the LIDAR is used [m]",
        "M",
        low=1,
        high=100,
    )
    expansion: float = option(
        2.0,
        "width of the predicted square divided by that of the window; limited to what the top "
        "speed needs: 10 m, or 14 m at 4 m/s",
        "X",
        low=1,
        high=4,
    )
    noise: float = option(
        0.0,
        f"standard deviation of the LIDAR's ranges, cut off at {NOISE_CUT:g} times as much [m]",
        "M",
        low=0,
        high=0.5,
    )
    dropout: float = option(
        0.0, "share of the LIDAR's beams that return nothing", "P", low=0, high=0.95
    )
    delay: float = option(
        0.0, "time from a scan until its control acts on the motors [s]", "S", low=0, high=1
    )
    jitter: float = option(
        0.0, "time by which this may take longer in any tick [s]", "S", low=0, high=0.1
    )
    lag: float = option(
        0.0,
        "time constant with which acceleration and curvature follow their commands [s]",
        "S",
        low=0,
        high=0.5,
    )
    pose_error: float = option(
        0.0,
        "largest error of the estimated position, which drifts and jumps [m]",
        "M",
        low=0,
        high=0.3,
    )
    yaw_error: float = option(
        0.0, "largest error of the estimated yaw [rad]", "RAD", low=0, high=0.1
    )
    missed: float = option(
        0.0, "probability that there is no decision in a tick", "P", low=0, high=0.9
    )
    told_delay: float | None = option(
        None, "delay that the navigator is told [s] (default: --delay)", "S", low=0, high=1
    )
    told_jitter: float | None = option(
        None, "jitter that it is told [s] (default: --jitter)", "S", low=0, high=0.1
    )
    told_lag: float | None = option(
        None, "lag that it is told [s] (default: --lag)", "S", low=0, high=0.5
    )
    told_pose_error: float | None = option(
        None, "error that it is told [m] (default: --pose-error)", "M", low=0, high=0.3
    )
    told_yaw_error: float | None = option(
        None, "error that it is told [rad] (default: --yaw-error)", "RAD", low=0, high=0.1
    )
    told_noise: float | None = option(
        None,
        "standard deviation of the ranges that it is told [m] (default: --noise)",
        "M",
        low=0,
        high=0.5,
    )
    real_time: bool = option(
        False,
        "drive on the wall clock, as on a robot: paths are searched for and predictions made in "
        "processes of their own, and a control that takes longer than its tick of 0.1 s is late: "
        "the car goes on with the manoeuvre that was kept. Such a drive cannot be repeated exactly",
    )
    deadline: float | None = option(
        None,
        "longest wait for a prediction; a later one is used from the tick on in which it is there, "
        f"where nothing was observed since (default: none, or {REAL_DEADLINE:g} with --real-time) "
        "[s]",
        "S",
        low=0.001,
        high=600,
    )
    vehicle: str = option(
        "dubins",
        f"dubins: forward only; reeds-shepp: with a reverse gear, at most {REVERSE:g} m/s or the "
        "speed that --car gives; differential: the same, and it turns on the spot, at "
        f"{TURN_RATE:g} rad/s or the rate that --car gives",
        choices=VEHICLES,
    )
    length: float = 0.5
    """Length of the car's body [m]; this and the next six come from `car`, see `with_defaults`."""
    width: float = 0.3
    """Width of the body [m]."""
    turning_radius: float = 0.8
    """Radius of the tightest arc [m]."""
    acceleration: float = 1.5
    """Maximum acceleration [m/s²]."""
    lateral_acceleration: float = 3.0
    """Maximum lateral acceleration [m/s²]."""
    reverse: float = REVERSE
    """Top speed in reverse of `reeds-shepp` and `differential` [m/s]."""
    turn_rate: float = TURN_RATE
    """Yaw rate of turns on the spot of `differential` [rad/s]."""
    calibrated: int = FIRST
    """Revision of the driving that the calibration for `risk` was measured with."""

    def __post_init__(self) -> None:
        super().__post_init__()
        stop = self.v_max**2 / (2.0 * self.braking)
        if stop > LONGEST_STOP:
            raise UsageError(
                f"--braking {self.braking:g}: a stop from --v-max {self.v_max:g} takes {stop:.0f} "
                f"m, at most {LONGEST_STOP:g} m are planned"
            )
        for name, form in (("start", "X Y YAW"), ("goal", "X Y")):
            place = getattr(self, name)
            if place is not None and len(place) != len(form.split()):
                raise UsageError(f"--{name} is {place}, it must be {form}")
        if (self.start is None) != (self.goal is None):
            given, missing = ("goal", "start") if self.start is None else ("start", "goal")
            raise UsageError(f"--{given} needs --{missing}: the two are one task")
        if self.start is not None and self.tasks is not None:
            raise UsageError("--start and --goal are one task, --tasks gives others: give only one")
        for arm in self.arms:
            if arm_kind(arm) not in ARMS:
                raise UsageError(f"no arm is called {arm!r}; there are {', '.join(ARMS)}")
        kinds = [ARMS[arm_kind(arm)] for arm in self.arms]
        if self.route == "fixed" and any(kind.frontiers for kind in kinds):
            raise UsageError("arms that end with +frontiers choose a route: they need --route free")
        if self.reliance == 1.0 and max(self.level, self.risk) > 0.0:
            raise UsageError("--level and --risk need a --reliance below 1")
        if len(set(self.arms)) < len(self.arms) or not self.arms:
            raise UsageError("--arms needs at least one arm, and each only once")

    @classmethod
    def of(cls, args: Namespace, *names: str) -> Self:
        """Make the settings from the parsed arguments of a command line; see `Options.of`."""
        return cls.with_defaults(**cls.parsed(args, *names))

    @classmethod
    def of_saved(cls, saved: Mapping[str, Any], **other: Any) -> Self:
        """Return the settings of a run from its file; what is no setting any more is left out.

        Args:
            saved: settings by name, as JSON has them.
            other: settings that replace saved ones.
        """
        known: dict[str, Any] = {f.name: saved[f.name] for f in fields(cls) if f.name in saved}
        known = {k: tuple(v) if isinstance(v, list) else v for k, v in known.items()}
        return cls(**known | other)

    @classmethod
    def with_defaults(cls, **given: Any) -> Self:
        """Make the settings from some that are given; a car and a start change other defaults.

        Args:
            given: settings by name. A car gives its body and limits; one task from `start` to
                `goal` is driven once.

        Raises:
            CarFileError: if the car cannot be read.
        """
        defaults = dict[str, Any]()
        if given.get("car") is not None:
            defaults |= vars(CarFile.read(given["car"]))
            kind = "differential" if defaults["turn_rate"] else "reeds-shepp"
            defaults["vehicle"] = kind if defaults["reverse"] else "dubins"
            # Of a car that lacks them, for --vehicle.
            defaults["reverse"] = defaults["reverse"] or REVERSE
            defaults["turn_rate"] = defaults["turn_rate"] or TURN_RATE
        if given.get("start") is not None:
            defaults["episodes"] = 1
        return cls(**defaults | given)

    @property
    def draws_tasks(self) -> bool:
        """Whether the tasks are drawn, not given by --tasks or by --start and --goal."""
        return self.tasks is None and self.start is None

    @property
    def bounds(self) -> ErrorBounds:
        """Bounds that the errors of the simulated robot keep to."""
        return ErrorBounds(
            delay=self.delay,
            jitter=self.jitter,
            lag=self.lag,
            position=self.pose_error,
            yaw=self.yaw_error,
            range=NOISE_CUT * self.noise,
        )

    @property
    def told_bounds(self) -> ErrorBounds:
        """Bounds that the navigator is told."""
        told = given(
            delay=self.told_delay,
            jitter=self.told_jitter,
            lag=self.told_lag,
            position=self.told_pose_error,
            yaw=self.told_yaw_error,
            range=None if self.told_noise is None else NOISE_CUT * self.told_noise,
        )
        return replace(self.bounds, **told)

    @property
    def families(self) -> tuple[str, ...]:
        """The families of generated buildings, which take turns; none for maps."""
        return self.world if set(self.world) <= set(FAMILIES) else ()

    def family(self, index: int) -> str:
        """Return the family of an episode; there must be `families`."""
        return self.families[index % len(self.families)]


NO_CONDITIONS = (
    *("world", "episodes", "seed", "arms", "predictor", "frontiers", "risk", "level"),
    *("uncertified", "calibrated", "car"),
)
"""Settings that a calibration need not share with the drives that use it; the predictor and the
buildings are compared in `benchmarks.calibration.certificate`. The car must be the same, whatever
its file is called."""
CONDITIONS = tuple(field.name for field in fields(Settings) if field.name not in NO_CONDITIONS)
"""Settings that a calibration must share with the drives that use it."""
OLDER: dict[str, Any] = loads(dumps({field.name: field.default for field in fields(Settings)}))
"""Setting → its first default, as plain data for JSON. Results and calibrations that do not contain
a setting are older than it; they were driven with this value."""
OLDER["reliance"] = 0.05


def up_to_date(settings: dict[str, Any]) -> dict[str, Any]:
    """Return the settings of saved results, also of older ones, under their present names."""
    if "reliance" in settings or "risk" not in settings:
        return OLDER | settings
    return OLDER | settings | {"reliance": settings["risk"], "risk": 0.0}


def checked(settings: dict[str, Any]) -> dict[str, Any]:
    """Return the settings of saved results, `up_to_date`, if each has the type of its field.

    Raises:
        ValueError: if one has not; the message names it.
    """
    hints = get_type_hints(Settings) | {"dt": float}
    wrong = [name for name, hint in hints.items() if not fits(settings.get(name, 0.0), hint)]
    if wrong:
        raise ValueError(f"the settings have no proper {wrong[0]}")
    return settings
