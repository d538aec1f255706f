"""A map that is edited between two commands, or during a run, is not driven as the same map."""

from dataclasses import replace

import numpy as np
import pytest
from comparison import run
from drive_results import a_result

from benchmarks.runs.drive import attempt
from benchmarks.runs.drive_file import DriveFile
from benchmarks.runs.settings import Settings
from benchmarks.runs.store import Store
from benchmarks.runs.time_optimal import ENTRY, KIND, read_t_opt
from benchmarks.runs.trace import Drive, Trace
from foresee.infra.command_line import UsageError
from foresee.infra.workers import WorkersError
from foresee.mapping.grid import FREE, OCCUPIED, Grid
from predictor.evaluation.drive_scores import DriveScores
from predictor.evaluation.settings import EvaluateConfig
from sim import empty_straight, save_world
from sim.buildings import map_hashes
from sim.world import World

STRAIGHT = empty_straight(20.0, 3.0)


def with_pillar(world):
    cells = world.grid.cells.copy()
    row, col = (side // 2 for side in cells.shape)
    cells[row, col] = OCCUPIED
    return World(world.name, Grid(world.grid.frame, cells))


def framed(**changes):
    return World("straight", Grid(replace(STRAIGHT.grid.frame, **changes), STRAIGHT.grid.cells))


EDITS = {
    "a cell": with_pillar(STRAIGHT),
    "resolution": framed(resolution=0.06),
    "origin": framed(origin=(1.0, 0.0)),
}


@pytest.fixture
def path(tmp_path):
    save_world(STRAIGHT, tmp_path / "straight.yaml")
    return tmp_path / "straight.yaml"


def settings_of(path, **changes):
    return Settings(world=(str(path),), episodes=1, arms=("known",), **changes)


def a_drive():
    arrays = {
        "e0/known/states": np.zeros((1, 4)),
        "w0/cells": np.full((1, 1), FREE, np.int8),
        "w0/frame": np.array([0.05, 0.0, 0.0]),
    }
    return Drive(a_result(), Trace(STRAIGHT.name, 0, "known", arrays))


def made(folder, path, maps):
    with Store(folder, settings_of(path), None, maps=maps) as store:
        store.add(a_drive())
        store.pack()


@pytest.mark.parametrize("edit", EDITS)
def test_a_run_is_not_continued_in_a_map_that_was_edited(tmp_path, path, edit):
    before = map_hashes((str(path),))
    made(tmp_path / "run", path, before)
    save_world(EDITS[edit], path)
    after = map_hashes((str(path),))
    assert after.keys() == before.keys()
    assert after != before
    with pytest.raises(UsageError, match=r"other maps: .*straight\.yaml"):
        Store(tmp_path / "run", settings_of(path), None, maps=after)
    with pytest.raises(UsageError, match=r"baselines .* other maps: .*straight\.yaml"):
        Store(tmp_path / "new", settings_of(path), None, tmp_path / "run", after)


def test_an_unchanged_map_is_continued_and_its_drives_are_copied(tmp_path, path):
    maps = map_hashes((str(path),))
    made(tmp_path / "run", path, maps)
    save_world(STRAIGHT, path)
    again = map_hashes((str(path),))
    with Store(tmp_path / "run", settings_of(path), None, maps=again) as store:
        assert store.done() == {(0, "known")}
        assert store.notes == []
    with Store(tmp_path / "new", settings_of(path), None, tmp_path / "run", again) as store:
        assert store.done() == {(0, "known")}
        assert store.notes == []


def test_older_runs_that_do_not_name_their_maps_are_read_and_a_line_says_so(tmp_path, path):
    made(tmp_path / "old", path, None)
    maps = map_hashes((str(path),))
    with Store(tmp_path / "new", settings_of(path), None, tmp_path / "old", maps) as store:
        assert store.done() == {(0, "known")}
        assert [note for note in store.notes if "does not name its maps" in note]
    with Store(tmp_path / "old", settings_of(path), None, maps=maps) as store:
        assert store.done() == {(0, "known")}
        assert [note for note in store.notes if "does not name its maps" in note]


def test_a_map_in_a_folder_is_not_added_or_removed_unnoticed(tmp_path, path):
    folder = (str(tmp_path),)
    before = map_hashes(folder)
    settings = Settings(world=folder, episodes=1, arms=("known",))
    Store(tmp_path / "run", settings, None, maps=before).__exit__()
    save_world(STRAIGHT, tmp_path / "another.yaml")
    with pytest.raises(UsageError, match=r"other maps: .*another\.yaml"):
        Store(tmp_path / "run", settings, None, maps=map_hashes(folder))


def test_a_worker_refuses_a_map_that_was_edited_during_the_run(path):
    maps = map_hashes((str(path),))
    save_world(EDITS["a cell"], path)
    with pytest.raises(WorkersError, match="another file"):
        attempt(settings_of(path, predictor="none"), None, (0, "known"), maps)


def test_time_optimal_drives_of_an_edited_map_are_refused(tmp_path, path):
    maps = map_hashes((str(path),))
    told = {"episodes": 1, "v_max": 4.0, "braking": 1.5}
    DriveFile(tmp_path / "new.json", KIND, told | {"maps": maps}, "episodes", None, ENTRY)
    DriveFile(tmp_path / "old.json", KIND, told, "episodes", None, ENTRY)
    assert read_t_opt(tmp_path / "new.json", settings_of(path), maps) == {}
    save_world(EDITS["a cell"], path)
    after = map_hashes((str(path),))
    assert read_t_opt(tmp_path / "old.json", settings_of(path), after) == {}
    with pytest.raises(UsageError, match=r"another version of .*straight\.yaml"):
        read_t_opt(tmp_path / "new.json", settings_of(path), after)


def test_the_command_says_in_one_line_that_a_map_was_edited(tmp_path, path, capsys):
    words = ("--world", path, "--episodes", 1, "--arms", "known", "--predictor", "none")
    words += ("--jobs", 1, "--out", tmp_path / "run")
    assert run(*words) == 0
    capsys.readouterr()
    save_world(EDITS["a cell"], path)
    assert run(*words) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "straight.yaml" in said


def test_scores_are_not_continued_in_a_map_that_was_edited(tmp_path, path):
    config = EvaluateConfig(world=(str(path),), drives=1, predictors=("none",))
    DriveScores(config, tmp_path / "scores")
    assert DriveScores(config, tmp_path / "scores").folder.notes == []
    save_world(EDITS["origin"], path)
    with pytest.raises(UsageError, match=r"other maps: .*straight\.yaml"):
        DriveScores(config, tmp_path / "scores")
