"""The prediction study's evaluation: what it measures, keeps, refuses and writes."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from generated_frames import generated, write_frames

from benchmarks.studies.katyal2018 import tables
from benchmarks.studies.katyal2018.__main__ import main
from benchmarks.studies.katyal2018.contestants import (
    _contestant,
    contestants,
    entrant,
    given_to,
    reduced,
)
from benchmarks.studies.katyal2018.cost import _size
from benchmarks.studies.katyal2018.evaluation import spaced
from benchmarks.studies.katyal2018.report import SSIM
from benchmarks.studies.katyal2018.square import ScoredSquare
from benchmarks.studies.katyal2018.transients import (
    counts,
    shares,
    transient_cells,
    with_transients,
)
from foresee.prediction import Prediction
from predictor.data.frames import Frames
from predictor.networks.grey_net import GreyNet
from predictor.networks.image_config import ImageConfig
from predictor.registry import PredictorError, load_predictor
from predictor.scoring.images import beyond_crop
from predictor.weights import save_weights

SPLITS = {"train": 3, "validation": 4, "test": 6, "more": 4}


class Hopeful:
    """Takes all that was not seen for free."""

    def predict(self, view):
        known = view.known
        free = np.where(known.unknown, 1.0, known.free).astype(np.float32)
        return Prediction(known.frame, free, 1.0 - free, np.ones_like(free))


class Broken(Hopeful):
    def predict(self, view):
        right = super().predict(view)
        return Prediction(view.known.frame, right.p_free[1:], right.p_occupied, right.confidence)


class Raising:
    def predict(self, view):
        raise RuntimeError("no memory\nof that")


class Nan(Hopeful):
    def predict(self, view):
        right = super().predict(view)
        right.p_free[:2] = np.nan
        return right


class Beyond(Hopeful):
    def predict(self, view):
        right = super().predict(view)
        return Prediction(view.known.frame, 2.0 * right.p_free, right.p_occupied, right.confidence)


@pytest.fixture(scope="module")
def sets(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sets")
    write_frames(
        folder / "simulated", {s: generated(n, i) for i, (s, n) in enumerate(SPLITS.items())}
    )
    write_frames(
        folder / "physical", {"hall": generated(5, 8), "yard": generated(3, 9)}, "physical"
    )
    return folder


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A folder as predictor.study leaves it, of two untrained networks at two expansions."""
    folder = tmp_path_factory.mktemp("study")
    for arch in ("unet_ff", "mlp"):
        for expansion in (1.1, 1.3):
            torch.manual_seed(0)
            net = GreyNet(ImageConfig(arch, expansion, width=1 / 16, side=64))
            (folder / f"{arch}-{expansion}").mkdir()
            path = folder / f"{arch}-{expansion}" / f"{arch}.safetensors"
            save_weights(path, net, {"network": vars(net.config), "config": {"epochs": 1.0}})
    return folder


@pytest.fixture(scope="module", autouse=True)
def one_whole_network():
    """Of the paper's networks one is timed whole, once: a quarter of a second."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("benchmarks.studies.katyal2018.cost.PAPER", ("unet_ff",))
        patch.setattr("benchmarks.studies.katyal2018.cost.PUBLISHED", 1)
        yield


@pytest.fixture(scope="module")
def done(sets, study, tmp_path_factory):
    out = tmp_path_factory.mktemp("out")
    arguments = [
        "--out",
        str(out),
        "--data",
        str(sets / "simulated"),
        "--logs",
        str(sets / "physical"),
        "--predictors",
        "none",
        "extend",
        str(study),
        "--expansions",
        "1.1",
        "1.3",
        "--apart",
        "0",
        "--jobs",
        "1",
    ]
    assert main(arguments) == 0
    return out, arguments, json.loads((out / "results.json").read_text())


@pytest.fixture
def undrawn(monkeypatch):
    """Without figures, which take most of the time."""
    monkeypatch.setattr("benchmarks.studies.katyal2018.figures.draw", lambda *_: [])


def command(sets, out, *more):
    return [
        "--out",
        str(out),
        "--data",
        str(sets / "simulated"),
        "--apart",
        "0",
        "--jobs",
        "1",
        "--expansions",
        "1.1",
        *more,
    ]


@pytest.mark.parametrize("name", ["compact", "compact-logs"])
def test_the_cost_of_a_shipped_network_is_counted(name):
    predictor = load_predictor(name)
    size = _size(_contestant(name, name), predictor, 200)
    assert size["parameters"] > 1_000_000
    assert size["macs"] > 100_000_000


@pytest.mark.parametrize("given", ["crop", "window"])
def test_a_network_is_given_what_it_was_trained_on(given, sets, tmp_path):
    net = GreyNet(ImageConfig("mlp", 1.3, given=given, width=1 / 16, side=64))
    save_weights(tmp_path / "mlp.safetensors", net, {})
    square = ScoredSquare.of(Frames.load(sets / "simulated", "test"), 2, 1.3)
    predictor = load_predictor(str(tmp_path / "mlp.safetensors"))
    assert given_to(predictor, square) is getattr(square, given)
    assert given_to(load_predictor("none"), square) is square.window


def test_cells_seen_in_the_crop_or_in_the_window_do_not_count(sets):
    frames = Frames.load(sets / "simulated", "test")
    for expansion in (1.1, 2.0):
        square = ScoredSquare.of(frames, 2, expansion)
        assert ((square.ring >= 0) == (square.crop.unknown & square.window.unknown)).all()
        assert (
            square.truth[~square.crop.unknown] == frames.truth(2, expansion)[~square.crop.unknown]
        ).all()
        inside = beyond_crop(len(square.truth)) < 0
        assert inside.sum() == 100 * 100
        assert square.crop.unknown[~inside].all()
        assert not square.unseen[inside].any()


def test_frames_are_chosen_by_the_way_between_them():
    ways = np.cumsum(np.full(40, 0.05)) - 0.05
    assert spaced(ways, 0.5).tolist() == [0, 10, 20, 30]
    assert spaced(ways, 0.0).tolist() == list(range(40))
    assert spaced(np.array([0.0, 1.2, 1.3, 2.0]), 0.5).tolist() == [0, 1, 3]


def test_results_have_all_that_was_asked(done):
    _, _, results = done
    names = {"copy", "grey", "none", "extend", "unet_ff", "mlp"}
    assert results["physical"].keys() == {"hall", "yard"}
    for entry in (results["simulated"], *results["physical"].values()):
        assert entry.keys() == {"1.10", "1.30"}
        for rows in entry.values():
            assert rows.keys() == names
            for row in rows.values():
                for name in (
                    "ssim",
                    "ssim_unseen",
                    "ssim_coarse",
                    "iou_free",
                    "iou_occupied",
                    "brier",
                    "nll",
                    "ece",
                ):
                    assert isinstance(row[name], float)
                assert -1 <= row["ssim"] <= 1
                assert 0 <= row["brier"] <= 1
    simulated = results["simulated"]["1.10"]["extend"]
    assert simulated["frames"] == SPLITS["test"] + SPLITS["more"]
    assert simulated["test"]["frames"] == SPLITS["test"]
    assert simulated["above"]["copy"]["ssim"]["groups"] == 2
    facts = results["predictors"]["unet_ff"]["1.10"]
    assert facts["reduced"]["width"] == 1 / 16
    assert facts["network"]["side"] == 64
    assert results["simulated"]["1.10"]["unet_ff"]["cost"]["macs"] > 0
    assert results["simulated"]["1.10"]["copy"]["cost"] is None
    assert results["published"]["unet_ff"]["parameters"] == 54_408_385
    assert results["transients"]["simulated"]["1.10"]["mlp"]["cells"] > 0
    assert results["transients"]["hall"]["1.10"]["mlp"]["filtered"] is None


def test_baselines_say_what_unseen_cells_are_on_the_validation_drives(done):
    _, _, results = done
    rows = results["simulated"]["1.30"]
    free, occupied = results["settings"]["rates"]["1.30"]
    assert 0 < occupied < free < 1
    assert rows["copy"]["brier"] == pytest.approx(rows["grey"]["brier"])
    assert rows["copy"]["brier_free"] < rows["none"]["brier_free"]
    assert rows["copy"]["ssim"] > rows["grey"]["ssim"]


def test_tables_have_the_papers_numbers_beside(done):
    out, _, _ = done
    text = (out / "tables.md").read_text()
    for network, published in SSIM["simulated"]["1.30"].items():
        line = next(line for line in text.splitlines() if f"the paper's {network}" in line)
        assert f"{published:.3f}" in line


def compared(ssim, **above):
    """A row of results: differences in SSIM, and their p values."""
    return {
        "ssim": ssim,
        "above": {
            other: {"ssim": {"value": value, "low": None, "high": None, "p": p}}
            for other, (value, p) in above.items()
        },
    }


def test_sites_are_counted_where_all_differences_are_significant_after_correction():
    sure, doubt = 1e-6, 0.04
    sites = {
        "attic": {
            "1.30": {
                "unet_ff": compared(0.9, copy=(0.1, sure), grey=(0.1, sure), none=(-0.1, sure)),
                "unet-logs": compared(0.99, copy=(0.1, sure), grey=(0.1, sure)),
                "compact": compared(0.9, copy=(0.1, sure), grey=(-0.1, sure)),
            }
        },
        "cellar": {
            "1.30": {
                "gan": compared(0.5, copy=(-0.1, sure), grey=(-0.1, sure)),
                # Alone, this difference would be significant.
                "unet_ff": compared(0.6, copy=(0.1, sure), grey=(0.1, doubt)),
                "compact": compared(0.9, copy=(0.1, sure), grey=(0.1, sure)),
            }
        },
        # Who was not asked is not above anyone.
        "shed": {"2.00": {"unet_ff": compared(0.9, copy=(0.1, sure), grey=(0.1, sure))}},
    }
    cells = [
        [cell.strip() for cell in line.split("|")[1:-1]]
        for line in tables._sites(sites, ["1.30", "2.00"]).splitlines()[2:]
    ]
    both, nothing = "`copy` and `grey`", ["0 / 0", "0 / 0"]
    assert cells == [
        ["`unet_ff`", both, "1 / 1", "0 / 0", *nothing],
        ["`unet_ff`", "`none`", "0 / 0", "1 / 0", *nothing],
        ["`compact`", both, "1 / 0", "0 / 0", *nothing],
        ["`compact`", "`none`", "0 / 0", "0 / 0", *nothing],
        ["`gan`", both, "0 / 0", "1 / 0", *nothing],
        ["`gan`", "`none`", "0 / 0", "0 / 0", *nothing],
    ]


def test_each_of_the_papers_networks_has_a_row_of_its_own():
    entry = {"1.30": {name: compared(0.9) for name in ("resnet_ff", "mlp", "gan", "unet_ff")}}
    rows = tables._baselines_table({"hall": entry}).splitlines()[2:]
    assert [row.split("|")[3].strip() for row in rows] == ["`unet_ff`", "`resnet_ff`", "`gan`"]


def test_differences_are_marked_if_they_are_significant_among_all_of_the_table():
    entry = {
        x: {"resnet_ff": compared(0.9, unet_ff=(0.1, p)), "gan": compared(0.5, unet_ff=(-0.1, p))}
        for x, p in (("1.10", 1e-6), ("1.30", 0.03))
    }
    first, second = tables._against_unet({"hall": entry}).splitlines()[2:]
    assert first.count("*") == 2
    assert second.count("*") == 0


def test_published_differences_have_p_values_from_their_intervals():
    path = Path(__file__).parents[3] / "docs/results/prediction.json"
    results = json.loads(path.read_text())
    lines = tables._against_unet(tables.split_places(results)).splitlines()
    (widest,) = (line for line in lines if line.startswith("| simulated    | 2.00 "))
    # The paper's U-Net lies below its ResNet here, and its GAN below both.
    assert "+0.047 (+0.039 to +0.055) *" in widest
    assert widest.count("*") == 4


def test_what_is_finished_is_not_done_again_and_what_is_lost_is(done, undrawn):
    out, arguments, results = done
    parts = sorted((out / "parts").iterdir())
    before = {path: path.stat().st_mtime_ns for path in parts}
    lost = [path for path in parts if path.name.startswith("scores-")][:2]
    lost[0].write_bytes(b"half")
    lost[1].unlink()
    assert main(arguments) == 0
    again = json.loads((out / "results.json").read_text())
    assert again == results
    redone = {path for path, time in before.items() if path.stat().st_mtime_ns != time}
    assert redone == set(lost)


def test_a_folder_may_grow(sets, tmp_path, undrawn):
    assert main(command(sets, tmp_path, "--predictors", "none")) == 0
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "parts").iterdir()}
    assert (
        main(command(sets, tmp_path, "--predictors", "none", "all=test_prediction_study:Hopeful"))
        == 0
    )
    after = {path: path.stat().st_mtime_ns for path in (tmp_path / "parts").iterdir()}
    assert before.items() < after.items()
    assert "all" in json.loads((tmp_path / "results.json").read_text())["simulated"]["1.10"]


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("Broken", r"p_free is float32 \(109, 110\), it must be real numbers \(110, 110\)"),
        ("Beyond", r"p_free has values outside \[0, 1\]"),
        ("Raising", "RuntimeError: no memory of that"),
    ],
)
def test_a_plug_in_that_breaks_the_contract_is_refused_in_a_line(sets, tmp_path, capsys, name, why):
    import re

    plug_in = f"test_prediction_study:{name}"
    assert main(command(sets, tmp_path, "--predictors", plug_in)) == 2
    line = capsys.readouterr().err.strip().splitlines()[-1]
    assert plug_in in line
    assert re.search(why, line)
    assert not (tmp_path / "results.json").exists()


def test_plug_ins_of_one_file_are_not_one():
    one, other = (
        contestants([f"test_prediction_study:{name}"], [1.1])[-1] for name in ("Nan", "Beyond")
    )
    assert one.identity != other.identity


def test_nan_counts_as_not_known_and_is_shown(sets, tmp_path, undrawn):
    assert main(command(sets, tmp_path, "--predictors", "test_prediction_study:Nan")) == 0
    row = json.loads((tmp_path / "results.json").read_text())["simulated"]["1.10"]
    assert row["test_prediction_study:Nan"]["nan_cells"] > 0
    assert "were NaN" in (tmp_path / "tables.md").read_text()


def test_what_cannot_be_compared_is_refused_in_a_line(sets, study, tmp_path, capsys):
    weights = str(study / "unet_ff-1.3" / "unet_ff.safetensors")
    wrong = [
        (["--predictors", weights], "expansion of 1.3"),
        (["--predictors", "nobody"], "no predictor is named"),
        (["--predictors", str(tmp_path)], "holds no trained networks"),
        (["--predictors", "grey=none"], "cannot be called grey"),
        (["--predictors", "one=none", "one=extend"], "both called one"),
        (["--data", str(sets / "physical")], "not a simulated one"),
        (["--data", str(tmp_path / "nothing")], "holds no data set"),
        (["--logs", str(tmp_path / "no.log")], "no such file"),
    ]
    for arguments, why in wrong:
        assert main(command(sets, tmp_path / "out", *arguments)) == 2
        err = capsys.readouterr().err.strip()
        assert why in err.splitlines()[-1], err
    assert main(["--expansions", "1.25"]) == 2


def test_networks_stand_at_their_own_expansion_alone(study):
    found = contestants([str(study), "b=" + str(study)], (1.1, 2.0))
    assert [one.name for one in found] == ["copy", "grey", "mlp", "unet_ff", "b/mlp", "b/unet_ff"]
    assert all(one.does(1.1) and not one.does(2.0) for one in found[2:])
    with pytest.raises(PredictorError, match="no network for any"):
        contestants([str(study)], (2.0,))


def test_a_training_as_published_is_not_reduced():
    from dataclasses import asdict

    from predictor.training.settings import ImageTraining

    facts = {"network": asdict(ImageConfig()), "config": asdict(ImageTraining(seed=3, sigma=0.2))}
    facts["frames"] = 5221
    assert reduced(facts) is None
    assert reduced(facts | {"frames": 46}) == {"frames": 46}
    facts["config"] = asdict(ImageTraining(batch=16, sigma=0.2, dropout=0.3))
    assert reduced(facts) == {"batch": 16, "dropout": 0.3}
    # The trainings that are published had the first weights of pix2pix, and record no dropout.
    facts["config"] = {"epochs": 200.0, "batch": 1, "rate": 2e-4, "sigma": 0.02, "brief": False}
    assert reduced(facts) == {"sigma": 0.02}


def test_every_figure_is_drawn(done):
    out, _, _ = done
    for name in (
        "ssim",
        "simulated",
        "physical",
        "worst",
        "maps-simulated",
        "maps-physical",
    ):
        assert (out / f"{name}.png").read_bytes().startswith(b"\x89PNG")


def test_transients_are_put_where_free_space_was_seen_and_found_again(sets):
    frames = Frames.load(sets / "simulated", "test")
    square = ScoredSquare.of(frames, 2, 1.3)
    given, put = with_transients(square, seed=0)
    assert put.any()
    assert square.crop.free[put].all()
    assert given.crop.occupied[put].all()
    assert (given.crop.cells[~put] == square.crop.cells[~put]).all()
    assert not transient_cells(square).any()
    assert (transient_cells(given) == put).all()


def test_a_network_that_copies_filters_nothing_and_one_that_whitens_all_keeps_no_wall(sets):
    square = ScoredSquare.of(Frames.load(sets / "simulated", "test"), 2, 1.3)
    of = {}
    for name in ("copy", "grey"):
        answer = entrant(contestants([], (1.3,))[name == "grey"], (0.5, 0.1))
        of[name] = shares(counts(answer, square, put_in=True, seed=0), put_in=True)
    assert of["copy"] | {"cells": 0, "wall_cells": 0} == {
        "cells": 0,
        "filtered": 0.0,
        "free_without": 1.0,
        "wall_cells": 0,
        "walls_kept": 1.0,
    }
    assert of["grey"]["walls_kept"] == 0.0


def test_logs_are_scored_without_a_simulated_set(sets, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    command = [
        "--out",
        "out",
        "--predictors",
        "none",
        "extend",
        "--expansions",
        "1.1",
        "--apart",
        "0",
        "--jobs",
        "1",
    ]
    assert main(command) == 2
    assert "data/simulated" in capsys.readouterr().err
    assert main([*command, "--logs", str(sets / "physical")]) == 0
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert results["simulated"] == {}
    assert list(results["physical"]) == ["hall", "yard"]
    assert results["settings"]["rates"]["1.10"] == [0.5, 0.5]
    figures = {path.name for path in (tmp_path / "out").glob("*.png")}
    assert {"ssim.png", "physical.png", "worst.png", "maps-physical.png"} <= figures
    assert "simulated.png" not in figures


def test_topics_without_bags_to_read_are_refused(sets, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for logs in ((), ("--logs", str(sets / "physical"))):
        assert main(["--out", "out", "--scans", "/front", *logs]) == 2
        assert "--scans needs bags as --logs" in capsys.readouterr().err
