"""Files of cars: what they mean, and what is refused."""

import math

import pytest
import yaml

from foresee.mapping.body import Body
from foresee.mapping.car_file import FOLDER, PRESETS, CarFile, CarFileError
from foresee.mapping.car_limits import CarLimits

CAR = {
    "length_m": 0.6,
    "width_m": 0.4,
    "turning_radius_m": 0.5,
    "top_speed_m_s": 2.0,
    "acceleration_m_s2": 1.0,
    "braking_m_s2": 1.5,
    "lateral_acceleration_m_s2": 2.0,
}
STEERED = {k: v for k, v in CAR.items() if k != "turning_radius_m"}
STEERED |= {"wheelbase_m": 0.4, "steering_limit_rad": 0.5}


def read(folder, content):
    path = folder / "car.yaml"
    path.write_text(content if isinstance(content, str) else yaml.safe_dump(content))
    return CarFile.read(str(path))


def test_a_file_gives_the_limits_and_the_body_of_a_car(tmp_path):
    read(tmp_path, CAR | {"reverse_speed_m_s": 0.7})
    assert CarLimits.read(str(tmp_path / "car.yaml")) == CarLimits(
        v_max=2.0,
        acceleration=1.0,
        braking=1.5,
        lateral_acceleration=2.0,
        turning_radius=0.5,
        body=Body(0.6, 0.4),
        reverse=0.7,
    )
    assert read(tmp_path, CAR).reverse == read(tmp_path, CAR).turn_rate == 0.0
    assert read(tmp_path, CAR | {"reverse_speed_m_s": 0.7, "turn_rate_rad_s": 2}).turn_rate == 2.0


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_is_a_car_and_says_where_its_figures_are_from(name):
    car = CarLimits.read(name)
    assert car.v_max > car.reverse
    text = (FOLDER / f"{name}.yaml").read_text()
    assert text.startswith("# ")
    assert "pproximate" in text or name == "paper"


def test_the_tightest_arc_of_the_rear_axle_follows_from_wheelbase_and_steering(tmp_path):
    rear = 0.4 / math.tan(0.5)
    at_axle = read(tmp_path, STEERED | {"rear_overhang_m": 0.1})
    assert at_axle.turning_radius == pytest.approx(rear)
    # The centre lies farther from the turning centre than the rear axle does.
    assert read(tmp_path, STEERED).turning_radius == pytest.approx(math.hypot(rear, 0.2))


@pytest.mark.parametrize("overhang", [0.0, 0.1, 0.3, 0.45, 0.6])
def test_a_body_around_the_rear_axle_covers_the_real_one(overhang, tmp_path):
    half = read(tmp_path, CAR | {"rear_overhang_m": overhang}).length / 2.0
    assert half >= max(overhang, 0.6 - overhang)
    assert half <= 0.6


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ("", "it holds None"),
        ("- 1", "it holds \\[1\\]"),
        ("{[", "YamlError"),
        (CAR | {"colour": "red"}, "'colour' is no key of a car; there are length_m"),
        (CAR | {"length": 0.5}, "'length' is no key"),
        (CAR | {7: 1}, "7 is no key"),
        (CAR | {"length_m": -1}, "length_m is -1, it must be a number from 0.1 to 5"),
        (CAR | {"length_m": "0.5 m"}, "length_m is '0.5 m', it must be a number"),
        (CAR | {"width_m": True}, "width_m is True"),
        (CAR | {"width_m": math.nan}, "width_m is nan"),
        (CAR | {"top_speed_m_s": math.inf}, "top_speed_m_s is inf"),
        (CAR | {"braking_m_s2": None}, "braking_m_s2 is None"),
        ({k: v for k, v in CAR.items() if k != "braking_m_s2"}, "it has no braking_m_s2"),
        (CAR | {"wheelbase_m": 0.3}, "it must have turning_radius_m, or wheelbase_m and"),
        (CAR | {"wheelbase_m": 0.3, "steering_limit_rad": 0.4}, "it must have turning_radius_m"),
        ({k: v for k, v in STEERED.items() if k != "wheelbase_m"}, "it has steering_limit_rad;"),
        ({k: v for k, v in CAR.items() if k != "turning_radius_m"}, "it has neither"),
        (CAR | {"top_speed_m_s": 10, "braking_m_s2": 0.5}, "takes 100 m, it must take at most 35"),
        (CAR | {"length_m": 2.0, "turning_radius_m": 0.1}, "it must be at least 0.255 m"),
        (CAR | {"turn_rate_rad_s": 1.0}, "so it must have reverse_speed_m_s"),
        (STEERED | {"turn_rate_rad_s": 1.0, "reverse_speed_m_s": 0.5}, "cannot turn on the spot"),
        (CAR | {"rear_overhang_m": 0.7}, "rear_overhang_m is 0.7, it must be at most the length"),
    ],
)
def test_a_broken_file_is_refused_with_its_name_and_the_reason(content, why, tmp_path):
    with pytest.raises(CarFileError, match=why) as refused:
        read(tmp_path, content)
    assert "car.yaml" in str(refused.value)


def test_what_is_neither_a_file_nor_a_preset_is_refused(tmp_path):
    with pytest.raises(CarFileError, match=r"'tank' is no car: give a \.yaml file or one of"):
        CarFile.read("tank")
    with pytest.raises(CarFileError, match="FileNotFoundError"):
        CarFile.read(str(tmp_path / "missing.yaml"))
