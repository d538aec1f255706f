"""Scoring predictors along drives, over worlds and maps."""

import json
import shutil
from types import SimpleNamespace

import numpy as np
import pytest

from foresee.mapping.grid import UNKNOWN, Grid, GridFrame, world_hash
from foresee.prediction import Prediction
from predictor.evaluate import main
from predictor.evaluation.drive_scores import report_groups, table
from predictor.evaluation.scored_drive import cells_of_a_car, score_drive
from predictor.evaluation.settings import EvaluateConfig
from predictor.provenance import has_learned
from predictor.recording.own_buildings import read_building
from predictor.scoring.scores import Scores
from sim import empty_straight, save_world
from sim.buildings import learned_forms
from sim.map_server import load_world
from sim.world import World, sealed


@pytest.fixture(scope="module")
def maps(tmp_path_factory):
    folder = tmp_path_factory.mktemp("halls")
    save_world(empty_straight(24.0, 3.0), folder / "hall.yaml")
    save_world(empty_straight(2.0, 2.0), folder / "hut.yaml")
    return folder


def run(*words):
    return main([str(word) for word in words])


@pytest.fixture(scope="module")
def evaluated(maps, tmp_path_factory):
    out = tmp_path_factory.mktemp("out")
    command = (
        "--world",
        maps,
        "--drives",
        1,
        "--predictors",
        "none",
        "extend",
        "--jobs",
        1,
        "--out",
        out,
    )
    assert run(*command) == 0
    return out, command


def test_it_writes_scores_and_pictures(evaluated):
    out, _ = evaluated
    assert {"results.json", "reliability.png", "rings.png", "sheet.png"} <= {
        path.name for path in out.iterdir()
    }
    results = json.loads((out / "results.json").read_text())
    (entry,) = results["groups"].values()
    assert entry["drives"] == 1
    assert entry["skipped"] == 1
    rows = entry["predictors"]
    ways = ("", " (c·p)", " (room)")
    assert set(rows) == {name + way for name in ("none", "extend") for way in ways} | {"grey"}
    assert rows["extend"]["iou_free"] > rows["none"]["iou_free"] == 0.0
    assert rows["extend"]["brier_free"] < rows["none"]["brier_free"]
    assert rows["extend"]["ssim"] > rows["grey"]["ssim"]
    assert len(rows["extend"]["rings"]) == 7
    # Of one building there is no knowing what another would have been like.
    assert rows["extend"]["ece_free_95"] is None
    assert results["settings"]["weights"] == {"none": None, "extend": None}
    assert "| 0.25–0.5 m" in table(results)


def test_the_same_command_again_drives_nothing_more(evaluated, monkeypatch):
    out, command = evaluated
    before = json.loads((out / "results.json").read_text())["groups"]

    def refuse(*_):
        pytest.fail("it drove again")

    monkeypatch.setattr("predictor.evaluation.scored_drive.score_drive", refuse)
    assert run(*command) == 0
    after = json.loads((out / "results.json").read_text())["groups"]
    assert json.dumps(after) == json.dumps(before)


def test_other_settings_do_not_overwrite_what_is_there(evaluated, capsys):
    _, command = evaluated
    assert run(*command, "--window", 7) == 2
    assert "holds a run with" in capsys.readouterr().err


@pytest.mark.parametrize(
    "wrong",
    [
        ("--world", "nowhere"),
        ("--world", "office", "office"),
        ("--predictors", "nobody"),
        ("--drives", 0),
        ("--seed", -1),
        ("--window", "inf"),
        ("--expansion", 0.5),
    ],
)
def test_bad_arguments_are_one_line_and_leave_nothing_behind(wrong, tmp_path, capsys):
    assert run(*wrong, "--out", tmp_path / "out") == 2
    error = capsys.readouterr().err
    assert error.startswith("predictor.evaluate: ")
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_damaged_part_is_scored_again(evaluated, tmp_path):
    was, command = evaluated
    out = tmp_path / "out"
    shutil.copytree(was, out)
    part, _ = sorted((out / "parts").iterdir())
    part.write_bytes(part.read_bytes()[:500])
    assert run(*command[:-1], out) == 0
    before, after = (
        json.loads((folder / "results.json").read_text())["groups"] for folder in (was, out)
    )
    for groups in (before, after):
        for row in next(iter(groups.values()))["predictors"].values():
            row.pop("ms", None)
    assert after == before


def test_damaged_settings_are_named(maps, tmp_path, capsys):
    (tmp_path / "settings.json").write_text("{")
    assert run("--world", maps, "--predictors", "none", "--out", tmp_path) == 2
    assert "settings.json cannot be read" in capsys.readouterr().err


def test_cells_that_were_seen_do_not_count(maps):
    config = EvaluateConfig((str(maps / "hall.yaml"),), ("none",), 1, every=20)
    facts, arrays = score_drive(config, (str(maps / "hall.yaml"), 0))
    scores = Scores(**{key: arrays[f"none/{key}"] for key in vars(Scores())})
    cells = facts["moments"] * 200 * 200
    assert 0 < scores.measures()["cells"] < cells
    # `none` gives no cell a chance of being free: all its mass is in the lowest level.
    assert scores.free[:, 1:].sum() == 0


def test_maps_are_reported_under_their_folder(maps):
    hall = str(maps / "hall.yaml")
    assert report_groups(["office", hall]) == {"office": "office", hall: maps.name}


class Graduate:
    """A predictor that has learned from the very building that it is asked about."""

    def __init__(self):
        from foresee.mapping.grid import world_hash
        from sim.map_server import load_world
        from sim.world import sealed

        self.facts = {"worlds": [world_hash(sealed(load_world(self.place)).grid.cells)]}

    def predict(self, view):
        from predictor.none import NoPrediction

        return NoPrediction().predict(view)


def test_buildings_that_a_predictor_has_learned_from_are_told(maps, monkeypatch):
    monkeypatch.setattr(Graduate, "place", maps / "hall.yaml", raising=False)
    names = ("none", f"{__name__}:Graduate")
    config = EvaluateConfig((str(maps / "hall.yaml"),), names, 1, every=50)
    facts, _ = score_drive(config, (str(maps / "hall.yaml"), 0))
    assert facts["learned_by"] == [names[1]]


@pytest.mark.slow(12)
def test_families_that_were_learned_from_are_scored_together_too(tmp_path):
    command = (
        "--world",
        "corridor",
        "office",
        "--seed",
        13,
        "--drives",
        1,
        "--predictors",
        "none",
        "--jobs",
        1,
        "--out",
        tmp_path,
    )
    assert run(*command) == 0
    groups = json.loads((tmp_path / "results.json").read_text())["groups"]
    one, other, both = (
        groups[name]["predictors"]["none"] for name in ("corridor", "office", "corridor + office")
    )
    assert both["cells"] == one["cells"] + other["cells"]
    mean = (one["cells"] * one["brier_free"] + other["cells"] * other["brier_free"]) / both["cells"]
    assert both["brier_free"] == pytest.approx(mean)


class Raising:
    def predict(self, view):
        raise RuntimeError("no memory of that")


class Narrow:
    def predict(self, view):
        none = np.zeros((3, 3), np.float32)
        return Prediction(view.known.frame, none, none, none)


@pytest.mark.parametrize(
    ("name", "says"),
    [("Raising", "RuntimeError: no memory of that"), ("Narrow", "p_free is float32 (3, 3)")],
)
def test_a_plug_in_that_breaks_the_contract_is_one_line(maps, tmp_path, capsys, name, says):
    command = ("--world", maps / "hall.yaml", "--drives", 1, "--jobs", 1, "--out", tmp_path)
    assert run(*command, "--predictors", f"test_evaluate:{name}") == 2
    assert says in capsys.readouterr().err.strip().splitlines()[-1]
    assert not (tmp_path / "results.json").exists()


class Small:
    """Predicts that all is free, in the square of 3 m that it states."""

    side = 3.0

    def predict(self, view):
        assert max(view.known.frame.shape) <= 61
        ones = np.ones(view.known.frame.shape, np.float32)
        return Prediction(view.known.frame, ones, 0.0 * ones, ones)


def test_a_predictor_is_asked_about_the_side_that_it_states(maps, tmp_path):
    command = ("--world", maps / "hall.yaml", "--drives", 1, "--jobs", 1, "--out", tmp_path)
    assert run(*command, "--predictors", "test_evaluate:Small", "none") == 0
    (group,) = json.loads((tmp_path / "results.json").read_text())["groups"].values()
    small, none = (group["predictors"][name] for name in ("test_evaluate:Small", "none"))
    assert small["cells"] == none["cells"]
    # In the cells outside of its square it predicts nothing, as `none` does everywhere.
    assert 0.0 < small["brier_free"] != none["brier_free"] < 1.0


def test_a_learned_map_of_another_resolution_is_told_too(tmp_path):
    cells = empty_straight(24.0, 3.0).grid.cells[::2, ::2].copy()
    # A wall one cell thick, by `sealed`; after resampling alone, it would have two unknown cells.
    cells[2, 20:30] = UNKNOWN
    world = World("coarse", Grid(GridFrame(0.1, (0.0, 0.0), cells.shape), cells))
    save_world(world, tmp_path / "coarse.yaml")
    trained = world_hash(read_building(tmp_path / "coarse.yaml").grid.cells)
    predictor = SimpleNamespace(facts={"worlds": [trained]})
    read = sealed(load_world(tmp_path / "coarse.yaml"))
    assert has_learned(predictor, learned_forms(read))
    assert not has_learned(predictor, [read.grid.cells])


def test_families_and_folders_are_never_one_group(tmp_path):
    maps = [str(tmp_path / name / "a.yaml") for name in ("office", "one/maps", "two/maps", "real")]
    groups = report_groups(["office", *maps])
    shown = ["office", f"{tmp_path.name}/office", "one/maps", "two/maps", "real"]
    assert list(groups.values()) == shown


@pytest.mark.parametrize(("resolution", "cells"), [(0.05, 7), (0.025, 14), (0.1, 4), (0.5, 1)])
def test_the_square_of_a_car_is_as_wide_at_any_resolution(resolution, cells):
    assert cells_of_a_car(resolution) == cells
