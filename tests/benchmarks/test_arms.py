"""The arms of a comparison: at which reliance and level their navigators drive."""

from dataclasses import replace

import numpy as np
import pytest
from short_drive import LIDAR, straight

from benchmarks.runs.arms import ARMS
from benchmarks.runs.driver import navigator_config, navigator_for, predictor_for
from benchmarks.runs.settings import Settings
from benchmarks.runs.tasks import make_task
from sim import NoTaskError

SETTINGS = Settings(reliance=0.05, level=0.02)


@pytest.mark.parametrize("name", [*ARMS])
def test_the_last_resort_relies_on_no_prediction_but_at_the_chosen_level_or_with_an_oracle(name):
    config = navigator_config(SETTINGS, ARMS[name])
    assert config.level == {"predicted": 0.02, "oracle": 1e-9}.get(name, 0.0)
    assert config.adapt == (name == "predicted")
    assert navigator_config(replace(SETTINGS, level=0.0), ARMS["predicted"]).level == 0.0


def test_a_fixed_level_is_not_adapted():
    assert not navigator_config(replace(SETTINGS, fixed_level=True), ARMS["predicted"]).adapt


@pytest.mark.parametrize("reliance", [0.0, 1.0])
def test_an_oracle_has_no_level_where_no_last_resort_is_needed(reliance):
    settings = Settings(reliance=reliance)
    config = navigator_config(settings, ARMS["oracle"])
    assert (config.reliance, config.level) == (reliance, 0.0)


def test_the_reliance_is_at_least_the_level():
    config = navigator_config(Settings(reliance=0.05, level=0.2), ARMS["predicted"])
    assert (config.reliance, config.level) == (0.2, 0.2)


@pytest.mark.parametrize("name", ["backup", "perfect"])
def test_a_belief_without_a_level_leads_the_plan_and_never_the_last_resort(name):
    task, arm = straight(), ARMS[name]
    settings = Settings(predictor="none", level=0.02)
    predictor = predictor_for(settings, arm, task)
    driver = navigator_for(settings, arm, task, predictor, deadline=60.0)
    start = np.array([*task.start, 0.0])
    risk = driver.step(start, LIDAR.scan(task.world, start, np.random.default_rng(0))).risk_map
    unseen = risk.known.unknown
    assert (risk.safe & unseen).any()
    assert not (risk.certain & unseen).any()
    assert not (risk.safe & risk.known.occupied).any()


def test_only_arms_with_a_prediction_let_it_influence_the_route():
    steering = {name for name in ARMS if navigator_config(SETTINGS, ARMS[name]).steer}
    predicting = {"known+route", "known+route+frontiers"}
    predicting |= {"predicted", "perfect", "oracle"}
    predicting |= {"known+truth10", "known+truth20", "known+truth40"}
    assert steering == predicting


def test_a_route_that_passes_a_place_twice_is_driven_freely_and_never_prescribed():
    settings = Settings(world=("narrow",), seed=9120008)
    assert make_task(settings, 0).comes_back
    with pytest.raises(NoTaskError, match="passes a place twice"):
        make_task(replace(settings, route="fixed"), 0)
    assert not make_task(replace(settings, route="fixed"), 1).comes_back
