"""The arms of a comparison: at which reliance and level their navigators drive."""

from dataclasses import replace

import pytest

from benchmarks.runs.drive import navigator_config
from benchmarks.runs.settings import ARMS, Settings

SETTINGS = Settings(reliance=0.05, level=0.02)


@pytest.mark.parametrize("name", [*ARMS])
def test_the_last_resort_relies_on_no_prediction_but_at_the_chosen_level_or_with_an_oracle(name):
    config = navigator_config(SETTINGS, ARMS[name], 0.1)
    assert config.level == {"predicted": 0.02, "oracle": 1e-9}.get(name, 0.0)
    assert config.adapt == (name == "predicted")
    assert navigator_config(replace(SETTINGS, level=0.0), ARMS["predicted"], 0.1).level == 0.0


def test_a_fixed_level_is_not_adapted():
    assert not navigator_config(replace(SETTINGS, fixed_level=True), ARMS["predicted"], 0.1).adapt


@pytest.mark.parametrize("reliance", [0.0, 1.0])
def test_an_oracle_has_no_level_where_no_last_resort_is_needed(reliance):
    settings = Settings(reliance=reliance)
    config = navigator_config(settings, ARMS["oracle"], 0.1)
    assert (config.reliance, config.level) == (reliance, 0.0)


def test_the_reliance_is_at_least_the_level():
    config = navigator_config(Settings(reliance=0.05, level=0.2), ARMS["predicted"], 0.1)
    assert (config.reliance, config.level) == (0.2, 0.2)
