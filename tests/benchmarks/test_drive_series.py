"""Series of drives of a study: they grow in turn, and are continued only if they are alike."""

import json
from dataclasses import asdict, dataclass, replace

import pytest
from drive_results import a_result

from benchmarks.runs.drive_series import drive_all
from benchmarks.runs.settings import Settings
from foresee.infra.command_line import UsageError
from foresee.mapping.grid import Grid
from planner.revision import FIRST
from sim import empty_straight, save_world
from sim.world import World


@dataclass(frozen=True)
class Series:
    name: str
    settings: Settings
    turns: int = 2


def driven(settings, weights, maps, index):
    (arm,) = settings.arms
    return asdict(a_result(arm=arm, index=index, time=10.0 * index, route=settings.route))


def driven_by_another_revision(settings, weights, maps, index):
    return driven(settings, weights, maps, index) | {"revision": FIRST}


def go(out, series, work=driven):
    return drive_all(series, out, "worth drives", work, 1.0, 1)


@pytest.fixture
def two(short_map):
    """Series of two arms in a map."""
    known = Settings(world=(str(short_map),), arms=("known",), predictor="none", episodes=4)
    return [Series("known", known), Series("full", replace(known, arms=("full",)))]


def test_all_series_grow_in_turn_and_go_on_where_they_were(two, tmp_path, capsys):
    drives, missing = go(tmp_path, two)
    assert not missing
    assert {name: [d["index"] for d in of] for name, of in drives.items()} == {
        "known": [0, 1, 2, 3],
        "full": [0, 1, 2, 3],
    }
    turns = [line for line in capsys.readouterr().out.splitlines() if " of " in line]
    assert turns == ["known, 2 of 4", "full, 2 of 4", "known, 4 of 4", "full, 4 of 4"]
    assert go(tmp_path, two) == (drives, 0)
    assert " of " not in capsys.readouterr().out


def test_drives_of_another_planner_or_another_map_are_not_continued(two, tmp_path, short_map):
    go(tmp_path / "old", two, driven_by_another_revision)
    with pytest.raises(UsageError, match=f"holds drives of revision {FIRST} of the planner"):
        go(tmp_path / "old", two)
    path = tmp_path / "edited.yaml"
    world = empty_straight(20.0, 3.0)
    save_world(world, path)
    edited = [replace(two[0], settings=replace(two[0].settings, world=(str(path),)))]
    go(tmp_path / "edited", edited)
    cells = world.grid.cells.copy()
    cells[cells.shape[0] // 2, cells.shape[1] // 2] = 100
    save_world(World("edited", Grid(world.grid.frame, cells)), path)
    with pytest.raises(UsageError, match="maps"):
        go(tmp_path / "edited", edited)


def test_the_file_of_a_series_says_of_which_maps_its_drives_are(two, tmp_path, short_map):
    go(tmp_path, two)
    content = json.loads((tmp_path / "known.json").read_text())
    assert list(content["settings"]["maps"]) == [str(short_map)]
