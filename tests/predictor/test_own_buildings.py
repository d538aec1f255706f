"""Training on buildings of one's own: maps and logs, split by building."""

import gzip
import math
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from written_bags import Bag

from foresee.infra.command_line import UsageError
from foresee.mapping.grid import FREE, OCCUPIED, Grid, GridFrame
from predictor.data.bag_config import BagConfig
from predictor.data.samples import Samples
from predictor.data.splits import check_apart
from predictor.drives import main as record_drives
from predictor.networks.compact_net import CompactNet
from predictor.recording.own_buildings import HELD_OUT, Building, OwnBuildings, read_building
from predictor.recording.settings import DrivesConfig
from predictor.recording.training_drives import _check, draw_place, make
from predictor.train import main
from predictor.training.settings import TUNING
from predictor.weights import load_weights, save_weights
from sim.families import generate
from sim.map_server import save_world
from sim.world import World


@pytest.fixture(scope="module")
def maps(tmp_path_factory):
    """Three buildings; one of them twice, and one file that is no map."""
    folder = tmp_path_factory.mktemp("maps")
    for name, seed in (("a", 1), ("b", 2), ("c", 3), ("copy", 2)):
        save_world(generate("narrow", seed), folder / f"{name}.yaml")
    (folder / "bad.yaml").write_text("image: nothing.png\n")
    return folder


def carmen(path, count=80, seen=True):
    """A log of a robot that drives 12 m along a corridor 4 m wide."""
    lines = []
    for number in range(count):
        angles = np.radians(np.arange(180) - 90.0 + 0.5)
        with np.errstate(divide="ignore"):
            ranges = np.minimum(2.0 / abs(np.sin(angles)), 20.0)
        if not seen:
            ranges = np.full(180, np.nan)
        x = 12.0 * number / count
        pose = f"{x:.3f} 0 0"
        numbers = " ".join(f"{r:.2f}" for r in ranges)
        lines.append(f"FLASER 180 {numbers} {pose} {pose} {number} robot {number}")
    path.write_text("\n".join(lines) + "\n")


def test_buildings_are_split_by_what_they_are_and_not_by_their_names(maps, tmp_path):
    one = OwnBuildings.read((str(maps),))
    assert len(one.train) == 2
    assert len(one.validation) == 1
    assert one.validation[0] not in one.train
    for old, new in (("a", "z"), ("b", "y"), ("c", "x")):
        save_world(generate("narrow", {"a": 1, "b": 2, "c": 3}[old]), tmp_path / f"{new}.yaml")
    assert OwnBuildings.read((str(tmp_path),)).hashes == one.hashes


def test_what_cannot_be_used_is_named_and_the_rest_is_kept(maps):
    bad, copy = OwnBuildings.read((str(maps),)).skipped
    assert "bad.yaml: missing key" in bad
    assert "copy.yaml holds the same as" in copy


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
        OwnBuildings.read((str(tmp_path / name),))


def test_drives_are_shared_out_evenly(maps):
    own = OwnBuildings.read((str(maps),))
    config = DrivesConfig(world=(str(maps),), share=0.25, families=("corridor", "paper"))
    mine = [("map", Path(one.paths[0])) for one in own.train]
    places = [draw_place(config, own, "train", number) for number in range(80)]
    generated = [(family, None) for family in config.families]
    assert [places.count(place) for place in (*mine, *generated)] == [10, 10, 30, 30]
    # All of a short set are not of one kind.
    assert set(places[:8]) == {*mine, *generated}
    held = {draw_place(config, own, "validation", number) for number in range(80)}
    assert held == {("map", Path(own.validation[0].paths[0])), *generated}


def test_the_drives_without_own_buildings_are_the_families_in_turn():
    config = DrivesConfig()
    places = [draw_place(config, OwnBuildings(), "train", number) for number in range(8)]
    count = len(config.families)
    assert places == [(config.families[number % count], None) for number in range(8)]


def test_one_building_is_trained_on_and_validation_is_on_generated_ones(maps, tmp_path, capsys):
    world = (str(maps / "a.yaml"),)
    own = OwnBuildings.read(world)
    assert (len(own.train), len(own.validation)) == (1, 0)
    config = DrivesConfig(world=world)
    assert draw_place(config, own, "validation", 1)[0] in config.families
    with pytest.raises(UsageError, match="cannot be both trained on and held out"):
        make(DrivesConfig(out=tmp_path, world=world, share=1.0), 1)


@pytest.mark.slow(10)
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
    check_apart({split: samples.worlds for split, samples in sets.items()})
    own = OwnBuildings.read((str(maps),))
    hashes = {split: {one.hashes[0] for one in own.of(split)} for split in sets}
    assert {split: samples.worlds for split, samples in sets.items()} == hashes
    facts = load_weights(tmp_path / "out" / "compact.safetensors", CompactNet)[1]
    assert facts["worlds"] == sorted(hashes["train"])
    # The settings of a fine-tuning are its own.
    tuned = replace(
        TUNING, steps=2, batch=2, start=load_weights(start, CompactNet)[1]["fingerprint"]
    )
    assert facts["config"] == asdict(tuned)
    # The set belongs to these buildings.
    (tmp_path / "more").mkdir()
    save_world(generate("narrow", 4), tmp_path / "more" / "d.yaml")
    with pytest.raises(UsageError, match="holds samples of other buildings of --world"):
        make(DrivesConfig(tmp_path / "data", 2, 1, world=(str(maps), str(tmp_path / "more"))), 1)


def test_a_building_that_was_held_out_stays_so_when_others_are_added(maps, tmp_path):
    for seed in range(20, 32):
        save_world(generate("narrow", seed), tmp_path / f"{seed}.yaml")
    few, many = (
        OwnBuildings.read(names) for names in ((str(tmp_path),), (str(tmp_path), str(maps)))
    )
    assert 1 <= len(few.validation) < len(few.train)
    assert set(few.validation) <= set(many.validation)
    assert set(few.train) <= set(many.train)


def test_weights_that_know_a_held_out_building_are_refused_before_any_drive(maps, tmp_path):
    held = OwnBuildings.read((str(maps),)).validation[0]
    config = DrivesConfig(out=tmp_path / "data", train=1, validation=1, world=(str(maps),))
    with pytest.raises(UsageError, match=r"have learned from .*which would be held out"):
        make(config, 1, frozenset(held.hashes))
    assert not (tmp_path / "data").exists()


def test_files_in_a_folder_of_their_own_are_of_one_building(tmp_path):
    for name, seed in (("a/1", 1), ("a/2", 2), ("b/3", 3), ("b/4", 4)):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        save_world(generate("narrow", seed), tmp_path / f"{name}.yaml")
    own = OwnBuildings.read((str(tmp_path),))
    both = [{Path(path).parent.name for path in one.paths} for one in (*own.train, *own.validation)]
    assert sorted(map(sorted, both)) == [["a"], ["b"]]
    config = DrivesConfig(world=(str(tmp_path),), share=1.0)
    paths = {draw_place(config, own, "train", number)[1] for number in range(4)}
    assert {str(path) for path in paths} == set(own.train[0].paths)


def test_a_map_is_learned_at_the_resolution_of_the_samples(tmp_path):
    fine = generate("narrow", 1)
    coarse = np.kron(fine.grid.cells[::2, ::2], np.ones((1, 1), np.int8))
    frame = GridFrame(0.1, (0.0, 0.0), coarse.shape)
    save_world(World("coarse", Grid(frame, coarse)), tmp_path / "coarse.yaml")
    world = read_building(tmp_path / "coarse.yaml")
    assert world.grid.frame.resolution == 0.05
    assert np.allclose(world.grid.frame.size, frame.size, atol=0.11)


def test_a_map_that_cannot_be_driven_in_and_a_log_that_sees_nothing_are_left_out(maps, tmp_path):
    closet = np.full((60, 60), OCCUPIED, np.int8)
    closet[10:30, 10:30] = FREE
    save_world(
        World("closet", Grid(GridFrame(0.05, (0.0, 0.0), (60, 60)), closet)),
        tmp_path / "closet.yaml",
    )
    carmen(tmp_path / "blind.log", seen=False)
    own = OwnBuildings.read((str(tmp_path), str(maps)))
    assert sum("closet" in line and "no way" in line for line in own.skipped) == 1
    assert sum("blind.log" in line and "no scan has" in line for line in own.skipped) == 1
    assert len(own.train) + len(own.validation) == 3


def test_maps_that_lie_too_deep_are_named(tmp_path):
    deep = tmp_path / "site" / "floor"
    deep.mkdir(parents=True)
    for number, folder in enumerate((tmp_path, deep)):
        save_world(generate("narrow", 9 + number), folder / "map.yaml")
    (line,) = OwnBuildings.read((str(tmp_path),)).skipped
    assert line.startswith(f"{deep}: ")


def test_a_log_is_known_again_when_it_is_packed(tmp_path):
    carmen(tmp_path / "one.log")
    (tmp_path / "packed.log.gz").write_bytes(gzip.compress((tmp_path / "one.log").read_bytes()))
    own = OwnBuildings.read((str(tmp_path),))
    assert len(own.train) == 1
    assert "holds the same as" in own.skipped[0]


def test_of_a_bag_with_two_lasers_the_topic_that_is_named_is_read(tmp_path):
    with Bag(tmp_path / "drive.bag", 1) as bag:
        for number in range(20):
            bag.pose(number, 0.5 * number, 0.0, 0.0)
            bag.scan(number, (3.0, 4.0, 5.0), topic="/front")
            bag.scan(number, (2.0, 2.0, 2.0), topic="/back")
    with pytest.raises(UsageError, match="several topics of scans: /back, /front; choose one by"):
        OwnBuildings.read((str(bag.path),))
    for topic in ("/front", "/back"):
        topics = BagConfig(scans=topic)
        (building,) = OwnBuildings.read((str(bag.path),), topics).train
        config = DrivesConfig(
            out=tmp_path / topic[1:],
            train=2,
            validation=1,
            families=("narrow",),
            world=(str(bag.path),),
            topics=topics,
        )
        make(config, 1)
        assert set(building.hashes) < Samples.load(config.out / "train").worlds


@pytest.mark.parametrize("command", [record_drives, main])
def test_topics_without_buildings_to_read_are_refused(command, tmp_path, capsys):
    assert command(["--scans", "/front", "--out", str(tmp_path)]) == 2
    assert "--scans needs --world" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("changes", "said"),
    [({"share": 0.0}, "--share is 0"), ({"validation": 200_000}, "--validation")],
)
def test_settings_that_make_no_sense_are_refused(maps, tmp_path, changes, said):
    with pytest.raises(UsageError, match=said):
        make(DrivesConfig(**({"out": tmp_path, "world": (str(maps),)} | changes)), 1)


def test_too_few_drives_for_all_buildings_are_told(maps, tmp_path, capsys):
    own = OwnBuildings.read((str(maps),))
    _check(DrivesConfig(out=tmp_path, train=2, validation=2, world=(str(maps),)), own, frozenset())
    assert "warning: no train drive is in 1 of the buildings" in capsys.readouterr().err


def test_weights_are_not_overwritten_by_their_own_fine_tuning(tmp_path, capsys):
    start = tmp_path / "compact.safetensors"
    save_weights(start, CompactNet(), {})
    assert main(["--start", str(start), "--out", str(tmp_path)]) == 2
    assert "would overwrite the weights" in capsys.readouterr().err


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


def test_a_building_of_many_maps_is_held_out_as_often_as_one_of_a_single_map():
    many = [Building((), tuple(f"{n:03d}{k}" for k in range(8))) for n in range(400)]
    share = np.mean([int(one.key[:8], 16) < HELD_OUT * 16**8 for one in many])
    assert share == pytest.approx(HELD_OUT, abs=0.07)
    assert Building(("a",), ("abc",)).key == "abc"
