"""Training on buildings of one's own: maps and logs, split by building."""

import math

import numpy as np
import pytest

from benchmarks.recording.own_buildings import OwnBuildings
from benchmarks.recording.settings import DrivesConfig
from benchmarks.recording.training_drives import make, place_of
from predictor.data.samples import Samples, check_apart
from predictor.infra.command_line import UsageError
from predictor.networks.compact_net import CompactNet
from predictor.train import main
from predictor.weights import load_weights, save_weights
from sim.families import generate
from sim.map_server import save_world


@pytest.fixture(scope="module")
def maps(tmp_path_factory):
    """Three buildings; one of them twice, and one file that is no map."""
    folder = tmp_path_factory.mktemp("maps")
    for name, seed in (("a", 1), ("b", 2), ("c", 3), ("copy", 2)):
        save_world(generate("narrow", seed), folder / f"{name}.yaml")
    (folder / "bad.yaml").write_text("image: nothing.png\n")
    return folder


def carmen(path, count=80):
    """A log of a robot that drives 12 m along a corridor 4 m wide."""
    lines = []
    for number in range(count):
        angles = np.radians(np.arange(180) - 90.0 + 0.5)
        with np.errstate(divide="ignore"):
            ranges = np.minimum(2.0 / abs(np.sin(angles)), 20.0)
        x = 12.0 * number / count
        pose = f"{x:.3f} 0 0"
        numbers = " ".join(f"{r:.2f}" for r in ranges)
        lines.append(f"FLASER 180 {numbers} {pose} {pose} {number} robot {number}")
    path.write_text("\n".join(lines) + "\n")


def test_buildings_are_split_by_what_they_are_and_not_by_their_names(maps, tmp_path):
    one = OwnBuildings.found((str(maps),))
    assert len(one.train) == 2
    assert len(one.validation) == 1
    assert not set(one.hashes[0]) & set(one.hashes[1])
    for old, new in (("a", "z"), ("b", "y"), ("c", "x")):
        save_world(generate("narrow", {"a": 1, "b": 2, "c": 3}[old]), tmp_path / f"{new}.yaml")
    assert OwnBuildings.found((str(tmp_path),)).hashes == one.hashes


def test_what_cannot_be_used_is_named_and_the_rest_is_kept(maps):
    bad, copy = OwnBuildings.found((str(maps),)).skipped
    assert "bad.yaml: missing key" in bad
    assert "copy.yaml is the same building as" in copy


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("nowhere.yaml", "no such file"),
        ("empty", "holds neither a .yaml map nor a log"),
        ("text.txt", "is neither a .yaml map, nor a log"),
        ("bad.yaml", "none of its files can be used: .*bad.yaml"),
        ("bad.log", "none of its files can be used: .*bad.log"),
    ],
)
def test_a_wrong_name_is_an_error_before_any_drive(tmp_path, name, said):
    (tmp_path / "empty").mkdir()
    for file in ("text.txt", "bad.yaml", "bad.log"):
        (tmp_path / file).write_text("nothing")
    with pytest.raises(UsageError, match=said):
        OwnBuildings.found((str(tmp_path / name),))


def test_drives_are_shared_out_evenly(maps):
    own = OwnBuildings.found((str(maps),))
    config = DrivesConfig(world=(str(maps),), share=0.25, families=("corridor", "paper"))
    places = [place_of(config, own, "train", number) for number in range(80)]
    assert [places.count(place) for place in (*own.train, *config.families)] == [10, 10, 30, 30]
    # All of a short set are not of one kind.
    assert set(places[:8]) == {*own.train, *config.families}
    held = {place_of(config, own, "validation", number) for number in range(80)}
    assert held == {*own.validation, *config.families}


def test_the_drives_without_own_buildings_are_the_families_in_turn():
    config = DrivesConfig()
    places = [place_of(config, OwnBuildings(), "train", number) for number in range(8)]
    count = len(config.families)
    assert places == [config.families[number % count] for number in range(8)]


def test_one_building_is_trained_on_and_validation_is_on_generated_ones(maps, tmp_path, capsys):
    world = (str(maps / "a.yaml"),)
    own = OwnBuildings.found(world)
    assert (len(own.train), len(own.validation)) == (1, 0)
    config = DrivesConfig(world=world)
    assert place_of(config, own, "validation", 1) in config.families
    with pytest.raises(UsageError, match="cannot be both trained on and held out"):
        make(DrivesConfig(out=tmp_path, world=world, share=1.0), 1)


@pytest.mark.slow
def test_fine_tuning_on_own_maps_prints_scores_of_held_out_ones(maps, tmp_path, capsys):
    start = tmp_path / "start.safetensors"
    save_weights(start, CompactNet(), {"worlds": [], "validation_worlds": []})
    arguments = ["--start", start, "--world", maps, "--share", 1, "--train", 2, "--validation", 1]
    arguments += ["--steps", 2, "--batch", 2, "--jobs", 1, "--data", tmp_path / "data"]
    assert main([str(word) for word in [*arguments, "--out", tmp_path / "out"]]) == 0
    out, err = capsys.readouterr()
    row = next(line for line in out.splitlines() if line.startswith("| map"))
    figures = [float(cell) for cell in row.split("|")[3:-1]]
    assert len(figures) == 5
    assert all(math.isfinite(figure) and 0 <= figure <= 1 for figure in figures)
    assert "skipped: " in err
    sets = {split: Samples.load(tmp_path / "data" / split) for split in ("train", "validation")}
    check_apart(sets)
    own = OwnBuildings.found((str(maps),))
    assert sets["train"].worlds == set(own.hashes[0])
    assert sets["validation"].worlds == set(own.hashes[1])
    facts = load_weights(tmp_path / "out" / "compact.safetensors", CompactNet)[1]
    assert facts["worlds"] == sorted(own.hashes[0])
    # The set belongs to these buildings.
    (tmp_path / "more").mkdir()
    save_world(generate("narrow", 4), tmp_path / "more" / "d.yaml")
    with pytest.raises(UsageError, match="holds a run with own"):
        make(DrivesConfig(tmp_path / "data", 2, 1, world=(str(maps), str(tmp_path / "more"))), 1)


def test_a_log_serves_as_a_building(tmp_path):
    for name, count in (("one", 80), ("two", 70)):
        carmen(tmp_path / f"{name}.log", count)
    make(DrivesConfig(tmp_path / "data", 1, 1, world=(str(tmp_path),), share=1.0, views=1), 1)
    samples = Samples.load(tmp_path / "data" / "train")
    assert samples.about[0]["family"] == "log"
    codes = np.stack([samples[number] for number in range(len(samples))])
    assert len(samples) >= 4
    # Free ahead on the map of all scans where nothing had been seen yet.
    assert ((codes % 3 == 2) & (codes // 3 == 0)).any()
