"""Training: it learns, it can be killed at any moment, and it says what it was made of."""

import json
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from foresee.infra.command_line import UsageError
from foresee.mapping.context import SIDE as CONTEXT
from foresee.mapping.grid import world_hash
from predictor.compact import SHIPPED
from predictor.data.samples import SIDE, Samples, encoded, write_samples
from predictor.data.squares import truth_codes
from predictor.networks.compact_net import CompactNet
from predictor.recording.own_buildings import OwnBuildings
from predictor.recording.rescan import rescanned
from predictor.recording.settings import DrivesConfig
from predictor.recording.training_drives import _claim
from predictor.train import main
from predictor.training import compact_training
from predictor.training import trainer as training_loop
from predictor.training.checkpoint import TrainError
from predictor.training.compact_training import CompactTrainer
from predictor.training.kinds_training import DOUBTS, train_layer
from predictor.training.settings import CompactTraining
from predictor.weights import load_weights, save_weights, weights_path
from sim import LidarConfig
from sim.families import generate
from sim.task import sample_task

CONFIG = CompactTraining(steps=12, batch=2, warmup=4)


def some_drive(folder, seed, family="narrow"):
    """A way through a building, without driving it: quick, and good enough to learn from."""
    task = sample_task(generate("narrow" if family == "map" else family, seed), seed)
    world, rng = task.world, np.random.default_rng(seed)
    ways = np.diff(task.waypoints, axis=0, prepend=[task.start[:2]])
    states = np.column_stack([task.waypoints, np.arctan2(ways[:, 1], ways[:, 0])])
    samples = []
    for known, state in rescanned(task, states, 5.0, LidarConfig(), rng, 1):
        crop = known.crop(known.frame.square(state[0], state[1], SIDE * 0.05))
        around = known.crop(known.frame.square(state[0], state[1], CONTEXT))
        truth = truth_codes(*world.truth(crop.frame))
        samples.append(encoded(crop, truth, around, state[2]))
    building = world_hash(world.grid.cells)
    about = {"seed": seed, "family": family, "world": building, "original": building}
    folder.mkdir(parents=True, exist_ok=True)
    write_samples(folder / f"{seed:06d}.npz", [(one, np.zeros(3)) for one in samples], about)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    for split, seeds in (("train", (1, 2)), ("validation", (3,))):
        for seed in seeds:
            some_drive(folder / split, seed)
    return folder


@pytest.fixture
def small(monkeypatch):
    """Small maps, one thread: a step takes a moment, and sums come out in one order."""
    monkeypatch.setattr(compact_training, "SQUARE_SIDES", (40, 80))
    monkeypatch.setattr(compact_training, "USUAL_SIDE", 80)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def trainer(data, out, config=CONFIG, note_every=4):
    train_set, validation = (Samples.load(data / name) for name in ("train", "validation"))
    one = CompactTrainer(config, train_set, validation, out)
    one.note_every = note_every
    return one


@pytest.mark.slow(7)
def test_a_killed_training_ends_as_if_it_had_not_been(data, tmp_path, small, monkeypatch):
    monkeypatch.setattr(training_loop, "SAVE_EVERY", 0.0)
    trainer(data, tmp_path / "whole").run()
    killed = trainer(data, tmp_path / "killed")
    learn, save = killed._learn, killed.save

    def die(*batch):
        if killed.step == 6:
            raise KeyboardInterrupt
        return learn(*batch)

    # Its last checkpoint is older than its log.
    monkeypatch.setattr(killed, "save", lambda: save() if killed.step == 3 else None)
    monkeypatch.setattr(killed, "_learn", die)
    with pytest.raises(KeyboardInterrupt):
        killed.run()
    assert [json.loads(line)["step"] for line in (killed.weights.parent / "log.jsonl").open()] == [
        4
    ]
    again = trainer(data, tmp_path / "killed")
    assert again.step == 3
    again.run()
    one, two = (tmp_path / name / "log.jsonl" for name in ("whole", "killed"))
    assert one.read_text() == two.read_text()
    assert [json.loads(line)["step"] for line in one.read_text().splitlines()] == [4, 8, 12]
    nets = [
        load_weights(tmp_path / n / "compact.safetensors", CompactNet)[0]
        for n in ("whole", "killed")
    ]
    assert all(
        torch.equal(a, b)
        for a, b in zip(nets[0].state_dict().values(), nets[1].state_dict().values(), strict=True)
    )


def test_it_learns(data, tmp_path, small):
    longer = CompactTraining(steps=30, batch=4, warmup=5)
    trainer(data, tmp_path, longer, note_every=10).run()
    losses = [json.loads(line)["loss"] for line in (tmp_path / "log.jsonl").open()]
    assert losses[-1] < 0.9 * losses[0]
    assert (tmp_path / "curve.png").stat().st_size > 5000


def test_the_weights_name_the_buildings_that_they_have_seen(data, tmp_path, small):
    one = trainer(data, tmp_path)
    one.run()
    _, facts = load_weights(tmp_path / "compact.safetensors", CompactNet)
    assert facts["worlds"] == sorted(one.train.worlds)
    assert facts["validation_worlds"] == sorted(one.validation.worlds)
    assert facts["config"]["steps"] == 12


def test_it_goes_on_from_weights_and_remembers_their_buildings(data, tmp_path, small):
    trainer(data, tmp_path / "one").run()
    start = load_weights(tmp_path / "one" / "compact.safetensors", CompactNet)
    some_drive(data / "more", 5)
    more, validation = (Samples.load(data / name) for name in ("more", "validation"))
    config = CompactTraining(steps=1, batch=2, rate=1e-9, start=start[1]["fingerprint"])
    CompactTrainer(config, more, validation, tmp_path / "two", start).run()
    net, facts = load_weights(tmp_path / "two" / "compact.safetensors", CompactNet)
    before, _ = load_weights(tmp_path / "one" / "compact.safetensors", CompactNet)
    assert facts["worlds"] == sorted(more.worlds | set(start[1]["worlds"]))
    assert facts["config"]["start"] == start[1]["fingerprint"]
    for name, values in before.named_parameters():
        assert torch.allclose(net.state_dict()[name], values, atol=1e-6)
    # Both compute in integers, and the ranges are measured anew.
    assert (before.ranges[:, 1] > before.ranges[:, 0]).all()
    assert (net.ranges[:, 1] > net.ranges[:, 0]).all()
    assert not torch.equal(net.ranges, before.ranges)


def test_another_training_in_the_folder_is_not_overwritten(data, tmp_path, small):
    trainer(data, tmp_path).save()
    with pytest.raises(TrainError, match="another config"):
        trainer(data, tmp_path, CompactTraining(steps=13, batch=2, warmup=4))


def test_other_validation_drives_are_another_training(data, tmp_path, small):
    trainer(data, tmp_path).save()
    some_drive(data / "other", 4)
    train_set, other = (Samples.load(data / name) for name in ("train", "other"))
    with pytest.raises(TrainError, match="another data, validation_worlds"):
        CompactTrainer(CONFIG, train_set, other, tmp_path)


def test_samples_of_another_recipe_are_not_mixed_in(tmp_path):
    _claim(DrivesConfig(tmp_path), OwnBuildings())
    _claim(DrivesConfig(tmp_path, train=7), OwnBuildings())
    with pytest.raises(UsageError, match="holds a run with longest"):
        _claim(DrivesConfig(tmp_path, longest=99.0), OwnBuildings())
    with pytest.raises(UsageError, match="holds a run with families"):
        _claim(DrivesConfig(tmp_path, families=("paper",)), OwnBuildings())


def test_a_recipe_in_another_order_is_the_same_and_a_damaged_one_is_named(tmp_path):
    _claim(DrivesConfig(tmp_path), OwnBuildings())
    recipe = tmp_path / "recipe.json"
    recipe.write_text(json.dumps(dict(reversed(json.loads(recipe.read_text()).items()))))
    _claim(DrivesConfig(tmp_path), OwnBuildings())
    recipe.write_text("{")
    with pytest.raises(UsageError, match="cannot be read"):
        _claim(DrivesConfig(tmp_path), OwnBuildings())


def test_a_damaged_checkpoint_is_named(data, tmp_path, small):
    one = trainer(data, tmp_path)
    one.save()
    one.checkpoint.write_bytes(one.checkpoint.read_bytes()[:1000])
    with pytest.raises(TrainError, match="cannot be read"):
        trainer(data, tmp_path)


def test_other_samples_of_the_same_buildings_are_another_training(data, tmp_path, small):
    trainer(data, tmp_path / "out").save()
    shutil.copytree(data, tmp_path / "data")
    path = tmp_path / "data" / "train" / "000001.npz"
    with np.load(path) as file:
        about = json.loads(bytes(file["about"]))
        first = file["codes"][: file["ends"][0]].tobytes()
    write_samples(path, [(first, np.zeros(3))], about)
    with pytest.raises(TrainError, match=r"another data, samples .* choose another folder"):
        trainer(tmp_path / "data", tmp_path / "out")


def test_weights_are_not_validated_on_what_they_have_learned(data, tmp_path, small, capsys):
    trainer(data, tmp_path / "one").run()
    weights = str(tmp_path / "one" / "compact.safetensors")
    swapped = tmp_path / "swapped"
    shutil.copytree(data / "train", swapped / "validation")
    shutil.copytree(data / "validation", swapped / "train")
    start = load_weights(Path(weights), CompactNet)
    config = CompactTraining(steps=1, start=start[1]["fingerprint"])
    train_set, validation = (Samples.load(swapped / name) for name in ("train", "validation"))
    with pytest.raises(TrainError, match="have learned from 2 of the buildings to validate on"):
        CompactTrainer(config, train_set, validation, tmp_path / "two", start)


@pytest.mark.slow(30)
def test_one_command_makes_samples_and_weights_and_goes_on_when_killed_without_warning(tmp_path):
    data = tmp_path / "data"
    command = ["--data", str(data), "--train", "1", "--validation", "1", "--steps", "4"]
    command += ["--batch", "2", "--jobs", "1"]
    assert main([*command, "--out", str(tmp_path / "whole")]) == 0
    assert len(Samples.load(data / "train")) > 20
    assert {"checkpoint.pt", "log.jsonl", "curve.png", "compact.safetensors"} <= {
        path.name for path in (tmp_path / "whole").iterdir()
    }
    out = tmp_path / "killed"
    program = [sys.executable, "-m", "predictor.train", *command, "--out", out]
    with subprocess.Popen(program, stderr=subprocess.PIPE) as process:
        while not (out / "log.jsonl").exists():
            assert process.poll() is None, process.stderr.read()
            time.sleep(0.01)
        process.kill()
    assert main([*command, "--out", str(out)]) == 0
    logs = [(tmp_path / name / "log.jsonl").read_text() for name in ("whole", "killed")]
    assert logs[0] == logs[1]
    fingerprints = [
        load_weights(tmp_path / name / "compact.safetensors", CompactNet)[1]["fingerprint"]
        for name in ("whole", "killed")
    ]
    assert fingerprints[0] == fingerprints[1]


@pytest.mark.parametrize(
    "wrong", [["--steps", "0"], ["--train", "-1"], ["--jobs", "0"], ["--rate", "0"]]
)
def test_arguments_that_make_no_sense_are_refused(wrong, capsys):
    assert main(wrong) == 2
    assert wrong[0] in capsys.readouterr().err


def test_weights_to_start_from_whose_facts_are_damaged_are_named(tmp_path, capsys):
    net, facts = load_weights(SHIPPED, CompactNet)
    save_weights(tmp_path / "odd.safetensors", net, facts | {"worlds": 5})
    assert main(["--start", str(tmp_path / "odd.safetensors"), "--data", str(tmp_path / "d")]) == 2
    assert "worlds is no list" in capsys.readouterr().err
    assert not (tmp_path / "d").exists()


def test_weights_to_start_from_that_do_not_exist_are_named_before_any_drive(tmp_path, capsys):
    assert main(["--start", "no.safetensors", "--data", str(tmp_path / "data")]) == 2
    assert "no.safetensors does not exist" in capsys.readouterr().err
    assert main(["--start", "compakt", "--data", str(tmp_path / "data")]) == 2
    assert "'compakt': choose one of compact, " in capsys.readouterr().err
    assert not (tmp_path / "data").exists()


def test_the_layer_of_kinds_learns_which_family_it_sees(tmp_path, capsys):
    for seed, family in ((1, "narrow"), (2, "corridor"), (3, "map")):
        some_drive(tmp_path / "data", seed, family)
    samples = Samples.load(tmp_path / "data")
    assert len(samples.families) == 3
    torch.manual_seed(0)
    net = CompactNet().with_context(4).eval()
    before = {name: values.clone() for name, values in net.state_dict().items()}
    path = train_layer(net, {"fingerprint": "0"}, samples, samples, tmp_path / "it.safetensors")
    fitted, facts = load_weights(path, CompactNet)
    assert fitted.architecture == "foresee-compact-4"
    assert set(facts["worlds"]) == samples.worlds
    after = fitted.state_dict()
    assert all(torch.equal(values, after[name]) for name, values in before.items())
    assert fitted.config.kinds == ("corridor", "narrow")
    assert fitted.doubts.tolist() == [1.0, DOUBTS["narrow"]]
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert rows[0] == ["corridor", "narrow"]
    assert min(float(rows[1][1]), float(rows[2][2])) > 0.6
    # It had no ranges; the layer changes none.
    assert (fitted.ranges[:, 1] > fitted.ranges[:, 0]).all()
    kept = fitted.with_ranges(2 * fitted.ranges)
    path = train_layer(kept, {"fingerprint": "0"}, samples, samples, tmp_path / "2.safetensors")
    assert torch.equal(load_weights(path, CompactNet)[0].ranges, kept.ranges)


def test_a_layer_of_kinds_that_cannot_be_trained_says_why(data, tmp_path):
    samples, facts, net = Samples.load(data / "train"), {"fingerprint": "0"}, CompactNet()
    path = tmp_path / "it.safetensors"
    with pytest.raises(TrainError, match="has no context"):
        train_layer(net, facts, samples, samples, path)
    net = net.with_context(4)
    with pytest.raises(TrainError, match="two families are needed; the samples are of narrow"):
        train_layer(net, facts, samples, samples, path)
    with pytest.raises(TrainError, match="have learned from 2 of the buildings"):
        train_layer(net, facts | {"worlds": sorted(samples.worlds)}, samples, samples, path)
    some_drive(tmp_path / "data", 1, "narrow")
    some_drive(tmp_path / "data", 2, "corridor")
    path.touch()
    both = Samples.load(tmp_path / "data")
    with pytest.raises(TrainError, match=r"it\.safetensors exists"):
        train_layer(net, facts, both, both, path)


def test_a_layer_of_kinds_is_refused_before_samples_are_made(tmp_path, capsys):
    save_weights(tmp_path / "bare.safetensors", CompactNet(), {})
    (tmp_path / "out").mkdir()
    common = ["--arch", "kinds", "--data", str(tmp_path / "data"), "--out", str(tmp_path / "out")]
    assert main([*common, "--start", str(tmp_path / "bare.safetensors")]) == 2
    assert "has no context" in capsys.readouterr().err
    assert main([*common, "--start", "compact", "--families", "corridor"]) == 2
    assert "two or more apart" in capsys.readouterr().err
    (tmp_path / "out" / "compact.safetensors").touch()
    assert main([*common, "--start", "compact"]) == 2
    assert "exists: choose another" in capsys.readouterr().err
    assert not (tmp_path / "data").exists()


def test_a_fine_tuning_leaves_the_layer_of_kinds_out_and_says_so(data, tmp_path, small, capsys):
    net = CompactNet().with_context(4).with_kinds(("corridor", "narrow"))
    train_set, validation = (Samples.load(data / name) for name in ("train", "validation"))
    config = replace(CONFIG, steps=1)
    path = CompactTrainer(config, train_set, validation, tmp_path, (net, {})).run()
    assert load_weights(path, CompactNet)[0].architecture == "foresee-compact-2"
    assert "The layer of kinds of --start is left out" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("wrong", "named"),
    [([], "give it as --start"), (["--start", "compact", "--steps", "3"], "--steps does not")],
)
def test_the_layer_of_kinds_has_no_schedule(wrong, named, capsys):
    assert main(["--arch", "kinds", *wrong]) == 2
    assert named in capsys.readouterr().err


def test_shipped_weights_are_named_and_files_are_given_by_their_path():
    assert weights_path(Path("compact")) == SHIPPED
    assert weights_path(Path("mine/compact.safetensors")) == Path("mine/compact.safetensors")
