"""The study: in order of worth, resumable, and no failure stops the rest."""

import dataclasses
import itertools
import math
import re

import pytest
from generated_frames import generated, write_frames

from foresee.infra.workers import LostError
from predictor.networks.grey_net import GreyNet
from predictor.networks.image_config import EXPANSIONS, ImageConfig
from predictor.study import ORDER, main
from predictor.training import parallel_trainings
from predictor.training.image_training import load_frames
from predictor.training.parallel_trainings import Study, Training
from predictor.training.settings import ImageTraining
from predictor.weights import save_weights

TINY = ["--width", "0.0625", "--side", "64", "--epochs", "0.2", "--batch", "1"]


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("frames") / "data"
    write_frames(folder, {"train": generated(10, 1), "validation": generated(4, 2)})
    return folder


def training_of(data, out, arch="mlp", expansion=1.1):
    config = ImageConfig(arch, expansion, width=1 / 16, side=64)
    digests = tuple(frames.digest for frames in load_frames(data))
    return Training(config, ImageTraining(epochs=0.2), data, digests, out / f"{arch}-{expansion}")


def test_all_twenty_are_there_and_what_is_worth_most_comes_first():
    assert len(ORDER) == len(set(ORDER)) == 20
    assert ORDER[:4] == (("unet_ff", 1.1), ("unet_ff", 1.3), ("unet_ff", 2.0), ("resnet_ff", 1.1))
    assert [arch for arch, _ in ORDER[-5:]] == 5 * ["mlp"]
    assert {expansion for _, expansion in ORDER} == set(EXPANSIONS)


@pytest.mark.slow(10)
def test_one_command_trains_them_all_and_passes_over_them_the_next_time(data, tmp_path, capsys):
    command = [
        "--data",
        str(data),
        "--out",
        str(tmp_path),
        "--jobs",
        "2",
        *TINY,
        "--archs",
        "unet_ff",
        "gan",
        "--expansions",
        "1.3",
    ]
    assert main(command) == 0
    table = capsys.readouterr().out.splitlines()
    assert [line.split()[:2] for line in table] == [
        ["unet_ff-1.3", "finished"],
        ["gan-1.3", "finished"],
    ]
    assert "epoch 0.2: l1 0." in table[0]
    assert re.search(r"adversarial \d\.\d+, discriminator \d\.\d+,", table[1])
    assert (tmp_path / "status.txt").read_text().splitlines() == table
    weights = [tmp_path / f"{arch}-1.3" / f"{arch}.safetensors" for arch in ("unet_ff", "gan")]
    made = [path.stat().st_mtime_ns for path in weights]
    assert main(command) == 0
    assert [path.stat().st_mtime_ns for path in weights] == made


@pytest.mark.slow(15)
def test_a_failure_is_shown_and_stops_no_other(data, tmp_path, capsys):
    bad = tmp_path / "mlp-1.1"
    bad.mkdir()
    (bad / "checkpoint.pt").write_bytes(b"nothing that torch could read")
    command = [
        "--data",
        str(data),
        "--out",
        str(tmp_path),
        "--jobs",
        "1",
        *TINY,
        "--archs",
        "mlp",
        "--expansions",
        "1.1",
        "1.3",
    ]
    assert main(command) == 1
    table = capsys.readouterr().out.splitlines()
    assert "failed: " in table[0]
    assert "checkpoint.pt cannot be read" in table[0]
    assert table[1].split()[1] == "finished"
    (bad / "checkpoint.pt").unlink()
    assert main(command) == 0


@pytest.mark.slow(15)
def test_when_time_is_up_it_stops_and_goes_on_another_time(data, tmp_path, monkeypatch):
    trainings = [training_of(data, tmp_path, expansion=expansion) for expansion in (1.1, 1.3)]
    now = itertools.count(0.0, 50.0)
    begun = Study(trainings, tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(parallel_trainings.time, "monotonic", lambda: next(now))
        begun.train(jobs=1, minutes=1)
    assert [line.split()[1] for line in begun.table().splitlines()] == ["stopped", "waiting"]
    assert (tmp_path / "status.txt").read_text().splitlines() == begun.table().splitlines()
    again = Study(trainings, tmp_path)
    again.train(jobs=1)
    assert list(again.state.values()) == ["finished", "finished"]


def test_a_process_that_dies_is_shown_and_stops_no_other(data, tmp_path, monkeypatch):
    dying, other = (training_of(data, tmp_path, expansion=of) for of in (1.1, 1.3))

    def finished(work, todo, jobs):
        yield other, "finished"
        raise LostError([dying])

    monkeypatch.setattr(parallel_trainings, "finished", finished)
    both = Study([dying, other], tmp_path)
    both.train(jobs=2)
    assert both.failures() == 1
    assert "failed: its process died" in both.line(dying)
    assert both.state[other] == "finished"


def test_a_folder_without_frames_is_named_before_any_training(tmp_path, capsys):
    assert main(["--data", str(tmp_path / "no"), "--out", str(tmp_path / "out"), *TINY]) == 2
    assert "no holds no data set" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_weights_of_another_schedule_are_not_passed_over_in_silence(data, tmp_path, capsys):
    one = training_of(data, tmp_path)
    one.out.mkdir(parents=True)
    facts = {"config": dataclasses.asdict(ImageTraining()), "network": {}}
    save_weights(one.out / "mlp.safetensors", GreyNet(one.config), facts)
    assert main(["--data", str(data), "--out", str(tmp_path), *TINY]) == 2
    assert "was trained in another way" in capsys.readouterr().err


def test_damaged_weights_are_named(data, tmp_path, capsys):
    one = training_of(data, tmp_path)
    one.out.mkdir(parents=True)
    (one.out / "mlp.safetensors").write_bytes(b"short")
    assert main(["--data", str(data), "--out", str(tmp_path), *TINY]) == 2
    assert "damaged" in capsys.readouterr().err


def test_an_interrupted_study_goes_on(data, tmp_path, monkeypatch):
    def interrupted(*args):
        raise KeyboardInterrupt

    command = ["--data", str(data), "--out", str(tmp_path), "--jobs", "1", *TINY]
    command += ["--archs", "mlp", "--expansions", "1.1"]
    with monkeypatch.context() as patch:
        patch.setattr(parallel_trainings, "train_images", interrupted)
        assert main(command) == 130
    assert main(command) == 0


@pytest.mark.parametrize("wrong", [["--jobs", "0"], ["--width", "9"], ["--minutes", "0"]])
def test_arguments_that_make_no_sense_are_refused(data, wrong, tmp_path, capsys):
    assert main([*wrong, "--data", str(data), "--out", str(tmp_path)]) == 2
    assert wrong[0] in capsys.readouterr().err


@pytest.mark.slow
def test_a_training_on_a_full_disk_ends_without_a_traceback(data, tmp_path, capfd):
    training = training_of(data, tmp_path)
    training.out.mkdir()
    # Every write to it fails as on a full disk.
    (training.out / "output.txt").symlink_to("/dev/full")
    (training.out / "log.jsonl").mkdir()
    assert training.train(end=math.inf).startswith("failed")
    assert "Traceback" not in capfd.readouterr().err
