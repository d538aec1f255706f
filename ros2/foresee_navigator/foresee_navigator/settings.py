"""The parameters of the nodes, with units, limits and descriptions."""

from __future__ import annotations

import math
from dataclasses import Field, dataclass, field, fields
from typing import Any

from foresee.mapping.body import Body
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.error_bounds import ErrorBounds
from planner.navigator_config import NavigatorConfig
from sim.lidar import LidarConfig


def parameter(
    default: bool | float | int | str,
    text: str,
    unit: str = "",
    *,
    low: float = -math.inf,
    high: float = math.inf,
    choices: tuple[str, ...] = (),
) -> Any:
    """Declare a field of a subclass of `Settings` that is a ROS parameter.

    Args:
        default: default value, whose type is that of the parameter.
        text: description.
        unit: unit of a number; "": it has none.
        low: smallest number allowed.
        high: largest number allowed.
        choices: words allowed; (): any.
    """
    limits = {"low": low, "high": high, "choices": choices}
    return field(default=default, metadata={"text": text, "unit": unit} | limits)


def described(setting: Field[Any]) -> str:
    """Return the description of a field, with its unit and its choices."""
    unit, choices = setting.metadata["unit"], setting.metadata["choices"]
    text = setting.metadata["text"] + (f" [{unit}]" if unit else "")
    return text + (f": {', '.join(choices)}" if choices else "")


@dataclass(frozen=True)
class Settings:
    """Base class of settings that are ROS parameters.

    Raises:
        ValueError: if a number lies outside of its limits, or a word is not among the choices.
    """

    def __post_init__(self) -> None:
        for setting in fields(self):
            value, data = getattr(self, setting.name), setting.metadata
            if data["choices"] and value not in data["choices"]:
                wanted = ", ".join(data["choices"])
                raise ValueError(f"{setting.name} is {value!r}, it must be one of {wanted}")
            if isinstance(value, str | bool):
                continue
            if not (data["low"] <= value <= data["high"] and math.isfinite(value)):
                raise ValueError(
                    f"{setting.name} is {value}, it must be finite and lie in "
                    f"[{data['low']:g}, {data['high']:g}]"
                )


@dataclass(frozen=True)
class CarSettings(Settings):
    """The car and the mount of its LIDAR, which both nodes need to know."""

    robot: str = parameter(
        "",
        "a car by its preset or YAML file, in place of the limits and the body below; empty: these",
    )
    v_max: float = parameter(2.0, "top speed", "m/s", low=0.05)
    acceleration: float = parameter(1.0, "maximum acceleration", "m/s²", low=0.05)
    braking: float = parameter(1.5, "maximum deceleration, on any floor", "m/s²", low=0.05)
    lateral_acceleration: float = parameter(
        3.0, "maximum lateral acceleration, on any floor", "m/s²", low=0.05
    )
    turning_radius: float = parameter(0.8, "radius of the tightest arc", "m", low=0.05)
    reverse: float = parameter(0.0, "top speed in reverse; 0: no reverse gear", "m/s", low=0.0)
    body_length: float = parameter(
        0.5, "length of the rectangle whose centre is the base frame", "m", low=0.05
    )
    body_width: float = parameter(0.3, "width of this rectangle", "m", low=0.05)
    lidar_x: float = parameter(0.1, "position of the LIDAR in the base frame, ahead", "m")
    lidar_y: float = parameter(0.0, "position of the LIDAR in the base frame, to the left", "m")
    lidar_yaw: float = parameter(0.0, "heading of the LIDAR in the base frame", "rad")

    @property
    def car(self) -> CarLimits:
        """The car's limits and its body.

        Raises:
            CarError: if there is no such car.
        """
        if self.robot:
            return CarLimits.read(self.robot)
        return CarLimits(
            v_max=self.v_max,
            acceleration=self.acceleration,
            braking=self.braking,
            lateral_acceleration=self.lateral_acceleration,
            turning_radius=self.turning_radius,
            body=Body(self.body_length, self.body_width),
            reverse=self.reverse,
        )

    @property
    def mount(self) -> tuple[float, float, float]:
        """Pose x, y, yaw of the LIDAR in the base frame [m, m, rad]."""
        return self.lidar_x, self.lidar_y, self.lidar_yaw


@dataclass(frozen=True)
class NavigatorSettings(CarSettings):
    """Parameters of the node `foresee_navigator`."""

    predict_only: bool = parameter(
        False, "publish maps and a speed limit, and send no command: another planner drives"
    )
    command: str = parameter(
        "twist", "type of the command", choices=("twist", "twist_stamped", "ackermann")
    )
    wheelbase: float = parameter(
        0.3, "distance between the axles, for the command ackermann", "m", low=0.01
    )
    map_frame: str = parameter(
        "", "frame of the goal, the path and the maps; empty: the frame of the odometry"
    )
    base_frame: str = parameter("base_link", "frame of the robot, in which the speed limit holds")
    predictor: str = parameter(
        "compact", "predictor of the map: its name, module:Class, or none for no prediction"
    )
    window: float = parameter(5.0, "side of the square around the car that is mapped", "m", low=1)
    resolution: float = parameter(0.05, "side of a cell of the maps", "m", low=0.01, high=0.5)
    reliance: float = parameter(
        0.0,
        "plans enter cells that are predicted free with a probability of 1 - reliance",
        low=0.0,
        high=1.0,
    )
    level: float = parameter(
        0.0,
        "so does the last resort, with 1 - level / doubt; above 0 the car may collide",
        low=0.0,
        high=1,
    )
    steer: bool = parameter(True, "predictions also influence the route")
    range_error: float = parameter(0.03, "largest error of a range", "m", low=0.0, high=0.5)
    pose_error: float = parameter(
        0.0, "largest error of the estimated position", "m", low=0.0, high=0.5
    )
    yaw_error: float = parameter(0.0, "largest error of the estimated yaw", "rad", low=0, high=0.2)
    delay: float = parameter(
        0.01,
        "shortest time from a tick until the command decided in it acts, computing included",
        "s",
        low=0.0,
        high=1.0,
    )
    jitter: float = parameter(0.09, "how much longer it may take, at most", "s", low=0.0, high=0.5)
    lag: float = parameter(
        0.0, "time constant with which the robot follows its commands", "s", low=0.0, high=0.5
    )
    start_margin: float = parameter(
        0.5, "margin around the body that counts as free where a map begins", "m", low=0.0
    )
    deadline: float = parameter(
        0.08, "longest wait for a prediction; a later one is used when it is there", "s", low=0.001
    )
    goal_radius: float = parameter(
        0.5, "distance from the goal within which it is reached, and the car stops", "m", low=0.05
    )
    timeout: float = parameter(
        0.5, "longest time without a scan or a pose, and their greatest age", "s", low=0.15
    )
    leap_distance: float = parameter(
        0.5, "error of the pose from one odometry to the next above which the map restarts", "m"
    )
    leap_angle: float = parameter(0.5, "the same for the heading", "rad", low=0.0)
    leap_time: float = parameter(
        0.2, "time by which stamps must go back for the map to restart", "s", low=0.0
    )
    map_period: float = parameter(0.5, "time from one published map to the next", "s", low=0.1)
    confidence: float = parameter(
        0.5, "confidence below which a cell of the predicted map is unknown", low=0.0, high=1.0
    )

    @property
    def navigator(self) -> NavigatorConfig:
        """Settings of the navigator.

        Raises:
            ValueError: if they contradict each other.
        """
        return NavigatorConfig(
            window=self.window,
            reliance=self.reliance,
            level=self.level,
            steer=self.steer,
            bounds=ErrorBounds(
                delay=self.delay,
                jitter=self.jitter,
                lag=self.lag,
                range=self.range_error,
                position=self.pose_error,
                yaw=self.yaw_error,
            ),
            start_margin=self.start_margin,
            deadline=self.deadline,
            car=self.car,
        )


@dataclass(frozen=True)
class SimulatorSettings(CarSettings):
    """Parameters of the node `foresee_simulator`."""

    world: str = parameter("corridor", "family of generated buildings, or file of a map (.yaml)")
    seed: int = parameter(1, "seed of the building, of its start and goal, and of noise", low=0)
    length: float = parameter(20.0, "least distance to the goal along the way", "m", low=2.0)
    range_noise: float = parameter(0.01, "standard deviation of a range", "m", low=0.0)
    beams: int = parameter(541, "number of beams of a scan", low=2)
    scan_period: float = parameter(0.1, "time from scan to scan", "s", low=0.02)
    odometry_period: float = parameter(0.02, "time from pose to pose", "s", low=0.02)
    command_timeout: float = parameter(
        0.5, "time without a command after which the robot brakes", "s", low=0.02
    )
    clock: bool = parameter(
        False, "publish /clock, which begins at 0; other nodes need use_sim_time"
    )
    speed_of_time: float = parameter(
        1.0, "simulated seconds in a second; other than 1 only with clock", low=0.5, high=20.0
    )
    odometry_frame: str = parameter("odom", "frame of the odometry and of the goal")
    base_frame: str = parameter("base_link", "frame of the robot")
    scan_frame: str = parameter("laser", "frame of the LIDAR")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.speed_of_time != 1.0 and not self.clock:
            raise ValueError(
                f"speed_of_time is {self.speed_of_time} without clock: set clock to true, and "
                "use_sim_time of the other nodes"
            )

    @property
    def lidar(self) -> LidarConfig:
        """Settings of the LIDAR."""
        return LidarConfig(beams=self.beams, mount=self.mount, range_noise=self.range_noise)
