"""What certificates hold for: calibrations outlive changes of the code, but not of the settings."""

import json
from dataclasses import asdict, dataclass, field, fields, is_dataclass, make_dataclass, replace
from types import SimpleNamespace

import pytest
from calibrations import written

from benchmarks.calibration import certificate
from benchmarks.calibration.certificate import (
    HASHED,
    SHIPPED,
    arms_at,
    at_risk,
    conditions_for,
    load_calibration,
)
from benchmarks.runs.arms import ARMS
from benchmarks.runs.settings import CONDITIONS, OLDER, Settings
from foresee.infra.command_line import UsageError
from foresee.infra.options import option
from foresee.mapping.grid import Grid
from planner.mpc.mpc import MPCConfig
from planner.navigator_config import NavigatorConfig
from planner.risk.calibration import CalibrationError
from predictor.provenance import has_learned
from sim import empty_straight, save_world
from sim.map_server import load_world
from sim.world import World

OFFICE, MIXTURE, MOST = (
    next(path for path in SHIPPED if path.stem == f"fixed-{name}")
    for name in ("office", "mixture", "mixture-built")
)
AT_RISK = Settings(world=("office",), route="fixed", risk=0.05)


def with_planner(monkeypatch, **changes):
    """Let the navigators of all drives have settings of their own."""
    made = certificate.navigator_config
    monkeypatch.setattr(
        certificate, "navigator_config", lambda *given: replace(made(*given), **changes)
    )


def all_settings(config, path=()):
    """Yield the path of each setting in a nested configuration, and its value."""
    for one in fields(config):
        value = getattr(config, one.name)
        if is_dataclass(value):
            yield from all_settings(value, (*path, one.name))
        else:
            yield (*path, one.name), value


def changed(config, path, value):
    first, *rest = path
    new = changed(getattr(config, first), rest, value) if rest else value
    object.__setattr__(copy := replace(config), first, new)
    return copy


def settings_of(calibration):
    """Settings of drives that a shipped calibration is for, at a risk of 5 %."""
    conditions = calibration.conditions
    chosen = {name: conditions[name] for name in CONDITIONS}
    return Settings(world=tuple(conditions["world"]), risk=0.05, **chosen)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_the_published_calibrations_are_accepted(path):
    assert at_risk(settings_of(load_calibration(path)), path).level > 0.0


def test_a_calibration_is_of_the_arm_predicted_alone(monkeypatch):
    with pytest.raises(UsageError, match="which --arms does not name"):
        at_risk(replace(AT_RISK, arms=("known", "oracle")), OFFICE)
    monkeypatch.setitem(ARMS, "bold", replace(ARMS["predicted"], steer=False))
    with pytest.raises(UsageError, match="not of bold"):
        at_risk(replace(AT_RISK, arms=("predicted", "bold")), OFFICE)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_drives_find_the_one_shipped_calibration_that_is_for_them(path):
    certificate = load_calibration(path)
    settings = settings_of(certificate)
    found = at_risk(settings)
    assert (found.level, found.uncertified) == (certificate.level_at(0.05), False)
    # A certificate that holds is taken, whether or not one would do without.
    assert at_risk(replace(settings, uncertified=True)) == found


def test_without_a_calibration_the_command_that_makes_one_is_told():
    for settings, words in (
        (replace(AT_RISK, world=("trap",), v_max=6.0), "--world trap --route fixed --v-max 6.0"),
        (replace(AT_RISK, risk=0.01), "--risks 0.01 --world office --route fixed"),
    ):
        with pytest.raises(UsageError, match=f"`foresee calibrate .*{words}`.*--uncertified"):
            at_risk(settings)


def test_drives_that_no_calibration_is_for_are_uncertified_at_the_level_of_a_mixture():
    here = replace(AT_RISK, world=("trap",), uncertified=True)
    found = at_risk(here)
    assert found.uncertified
    assert found.level == load_calibration(MOST).level_at(0.05)
    # Of the calibrations of mixtures, that of the same buildings goes first.
    families = tuple(load_calibration(MIXTURE).conditions["world"])
    found = at_risk(replace(here, world=families, window=10.0))
    assert found.uncertified
    assert found.level == load_calibration(MIXTURE).level_at(0.05)
    assert at_risk(here, OFFICE).level == load_calibration(OFFICE).level_at(0.05)
    with pytest.raises(UsageError, match="nor of a mixture for the same predictor and route"):
        at_risk(replace(here, predictor="extend"))
    with pytest.raises(CalibrationError, match="is for world office, not trap"):
        at_risk(replace(here, uncertified=False), OFFICE)


def test_several_risks_are_several_arms_with_levels_of_their_own():
    settings = replace(AT_RISK, risk=0.0, arms=("known", "predicted", "oracle"))
    arms = arms_at(settings, (0.0, 0.02, 0.05))
    assert list(arms) == ["known", "predicted", "predicted 2 %", "predicted 5 %", "oracle"]
    levels = load_calibration(OFFICE).levels
    assert [of.level for of in arms.values()] == [0.0, 0.0, levels[0.02], levels[0.05], 0.0]
    assert {of.arms for of in arms.values()} == {tuple(arms)}
    with pytest.raises(UsageError, match="no arm is called 'predicted 2 %': give the risk"):
        arms_at(replace(settings, arms=("predicted 2 %",)), (0.0,))


@pytest.mark.parametrize("path", [p for p, _ in all_settings(NavigatorConfig())], ids=".".join)
def test_another_value_of_any_setting_of_the_planner_is_refused(path, monkeypatch):
    made = certificate.navigator_config
    monkeypatch.setattr(certificate, "navigator_config", lambda *a: changed(made(*a), path, 99))
    with pytest.raises(CalibrationError, match="is for planner"):
        at_risk(AT_RISK, OFFICE)


def test_a_new_setting_of_the_planner_counts_only_if_it_is_not_at_its_default(monkeypatch):
    newer = make_dataclass("Newer", [("pace", float, 1.0)], bases=(NavigatorConfig,), frozen=True)
    nested = make_dataclass(
        "Nested", [("look", tuple, field(default=(1.0,)))], bases=(MPCConfig,), frozen=True
    )
    made = certificate.navigator_config

    def with_new(pace, look):
        def build(*given):
            old = made(*given)
            present = {one.name: getattr(old, one.name) for one in fields(old)}
            return newer(**present | {"pace": pace, "mpc": nested(look=look)})

        monkeypatch.setattr(certificate, "navigator_config", build)

    with_new(1.0, (1.0,))
    assert at_risk(AT_RISK, OFFICE).level == 0.3
    for other in ((2.0, (1.0,)), (1.0, (2.0,))):
        with_new(*other)
        with pytest.raises(CalibrationError, match="is for planner"):
            at_risk(AT_RISK, OFFICE)


def test_each_setting_of_the_planner_is_hashed_or_listed_here_with_its_default():
    # A calibration without a newer setting stands for the default that it had when it was new.
    bounds = ("delay", "jitter", "lag", "position", "yaw", "range")
    newer = {"car.turn_rate": 0.0} | {f"bounds.{name}": 0.0 for name in bounds}
    hashed = {f"{part}.{name}".lstrip(".") for part, s in HASHED.items() for name in s.split()}
    present = {".".join(path): value for path, value in all_settings(NavigatorConfig())}
    assert {name: value for name, value in present.items() if name not in hashed} == newer


@dataclass(frozen=True)
class NewerSettings(Settings):
    fan: float = option(1.0, "angle")


def test_a_new_setting_of_the_drives_counts_only_if_it_is_not_at_its_default(monkeypatch):
    monkeypatch.setattr(certificate, "ABSENT", certificate.ABSENT | {"fan": 1.0})
    newer = NewerSettings(**{f.name: getattr(AT_RISK, f.name) for f in fields(AT_RISK)})
    assert at_risk(newer, OFFICE).level == 0.3
    with pytest.raises(CalibrationError, match=r"is for fan 1\.0, not 2"):
        at_risk(replace(newer, fan=2.0), OFFICE)


@pytest.mark.parametrize("name", CONDITIONS)
def test_a_setting_that_a_calibration_does_not_contain_means_its_default(name, tmp_path):
    found = json.loads(OFFICE.read_text())
    default = Settings(world=("office",), risk=0.05, reliance=OLDER["reliance"])
    found["conditions"] = json.loads(json.dumps(conditions_for(default)))
    del found["conditions"][name]
    path = tmp_path / "calibration.json"
    path.write_text(json.dumps(found))
    assert at_risk(default, path).level == 0.3


def test_the_defaults_of_settings_that_published_results_lack_are_those_they_were_driven_with():
    driven = {"vehicle": "dubins", "braking": 1.5, "frontiers": "learned", "reliance": 0.05}
    driven |= {"risk": 0.0, "level": 0.0, "fixed_level": False}
    assert driven.items() <= OLDER.items()
    assert OLDER.keys() == asdict(Settings()).keys()


def test_the_hash_of_the_planner_is_a_condition(monkeypatch):
    before = conditions_for(AT_RISK)
    with_planner(monkeypatch, start_margin=0.3)
    assert {k: v for k, v in conditions_for(AT_RISK).items() if before[k] != v}.keys() == {
        "planner"
    }


def own_map(folder, resolution):
    world = empty_straight(20.0, 3.0)
    frame = replace(world.grid.frame, resolution=resolution)
    save_world(World("straight", Grid(frame, world.grid.cells)), folder / "straight.yaml")
    return replace(AT_RISK, world=(str(folder / "straight.yaml"),), predictor="none")


def test_a_calibration_holds_for_the_resolution_of_its_maps(tmp_path):
    here = own_map(tmp_path, 0.05)
    path = written(tmp_path / "c.json", conditions=conditions_for(here))
    assert at_risk(here, path).level > 0.0
    assert conditions_for(here)["resolutions"] == [0.05]
    with pytest.raises(CalibrationError, match=r"resolutions 0\.05, not 0\.1"):
        at_risk(own_map(tmp_path, 0.1), path)


def test_an_older_calibration_of_own_maps_is_of_the_usual_resolution(tmp_path):
    here = own_map(tmp_path, 0.05)
    conditions = conditions_for(here)
    del conditions["resolutions"]
    path = written(tmp_path / "c.json", conditions=conditions)
    assert at_risk(here, path).level > 0.0
    with pytest.raises(CalibrationError, match=r"resolutions 0\.05, not 0\.1"):
        at_risk(own_map(tmp_path, 0.1), path)


@pytest.mark.parametrize("maps", [5, None, "x", {"a": 1}, [[]]])
def test_conditions_of_maps_may_be_anything(tmp_path, maps):
    here = own_map(tmp_path, 0.05)
    path = written(tmp_path / "c.json", conditions=conditions_for(here) | {"maps": maps})
    with pytest.raises(CalibrationError, match="maps"):
        at_risk(here, path)


def test_a_learned_building_is_known_by_its_cells(tmp_path):
    here = own_map(tmp_path, 0.05)
    cells = load_world(here.world[0]).grid.cells
    learned = SimpleNamespace(facts={"worlds": conditions_for(here)["maps"]})
    assert has_learned(learned, [cells])


def test_a_calibration_without_any_risk_is_refused():
    plain = replace(AT_RISK, risk=0.0)
    with pytest.raises(UsageError, match="--calibration needs a --risk above 0"):
        arms_at(plain, (0.0,), OFFICE)
    with pytest.raises(UsageError, match="--uncertified needs a --risk above 0"):
        arms_at(replace(plain, uncertified=True), (0.0,))
    assert len(arms_at(plain, (0.0, 0.02), OFFICE)) == len(plain.arms) + 1
