"""Training the paper's networks: it learns, can be killed, and says what it was made of."""

import json
import zlib

import numpy as np
import pytest
import torch
from generated_frames import generated, write_frames

from benchmarks.studies.katyal2018.contestants import reduced
from foresee.mapping.context import CELLS
from predictor.data.samples import Samples, write_samples
from predictor.data.splits import SplitError
from predictor.networks import ARCHITECTURES
from predictor.networks.grey_net import GreyNet
from predictor.networks.image_config import ImageConfig
from predictor.train import main
from predictor.training.checkpoint import TrainError
from predictor.training.image_training import ImageTrainer, train_images
from predictor.training.settings import PRESETS, ImageTraining, described
from predictor.training.trainer import Stopped
from predictor.weights import load_weights

TRAIN, VALIDATION = generated(10, 1), generated(4, 2)
TINY = {"width": 1 / 16, "side": 64}


@pytest.fixture(autouse=True)
def one_thread():
    """Sums come out in one order."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def trainer(out, arch="unet_ff", train=TRAIN, validation=VALIDATION, **training):
    learns = ImageTraining(**{"epochs": 2.0, "batch": 2, "rate": 2e-3} | training)
    over = "image" if learns.batch == 1 else "batch"
    config = ImageConfig(arch, 1.3, over=over, **TINY)
    return ImageTrainer(config, learns, train, validation, out)


def log_of(out):
    return [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]


def test_told_to_stop_it_leaves_a_checkpoint_and_ends_as_if_it_had_not(tmp_path):
    whole = trainer(tmp_path / "whole").run()
    for step in (1, 2):
        with pytest.raises(Stopped):
            trainer(tmp_path / "stopped").run(end=0.0)
        assert trainer(tmp_path / "stopped").step == step
    path = trainer(tmp_path / "stopped").run()
    fingerprints = [load_weights(each, GreyNet)[1]["fingerprint"] for each in (whole, path)]
    assert fingerprints[0] == fingerprints[1]


def test_other_frames_are_another_training(tmp_path):
    trainer(tmp_path).save()
    with pytest.raises(TrainError, match="another data"):
        trainer(tmp_path, train=generated(len(TRAIN), 77))


@pytest.mark.parametrize("arch", ARCHITECTURES)
@pytest.mark.parametrize("batch", [1, 4])
def test_a_killed_training_ends_as_if_it_had_not_been(tmp_path, monkeypatch, arch, batch):
    monkeypatch.setattr("predictor.training.trainer.SAVE_EVERY", 0.0)
    settings = {"arch": arch, "epochs": 1.2, "batch": batch}
    whole = trainer(tmp_path / "whole", **settings).run()
    killed = trainer(tmp_path / "killed", **settings)
    middle = killed.steps // 2
    learn, save = killed._learn, killed.save
    # Its log is a step further than its last checkpoint.
    monkeypatch.setattr(killed, "save", lambda: save() if killed.step == middle else None)

    def die(*images):
        if killed.step == middle + 1:
            raise KeyboardInterrupt
        return learn(*images)

    monkeypatch.setattr(killed, "_learn", die)
    with pytest.raises(KeyboardInterrupt):
        killed.run()
    again = trainer(tmp_path / "killed", **settings)
    assert again.step == middle
    path = again.run()
    assert log_of(tmp_path / "whole") == log_of(tmp_path / "killed")
    fingerprints = [load_weights(each, GreyNet)[1]["fingerprint"] for each in (whole, path)]
    assert fingerprints[0] == fingerprints[1]


@pytest.mark.parametrize("arch", ["unet_ff", "resnet_ff", "mlp"])
def test_it_learns(tmp_path, arch):
    trainer(tmp_path, arch, epochs=8.0).run()
    losses = [entry["l1"] for entry in log_of(tmp_path)]
    assert losses[-1] < 0.8 * losses[0]
    assert (tmp_path / "curve.png").stat().st_size > 5000


def test_generator_and_discriminator_both_move(tmp_path):
    one = trainer(tmp_path, "gan", epochs=8.0)
    before = [values.clone() for values in one.learner.judge.parameters()]
    one.run()
    log = log_of(tmp_path)
    assert log[-1]["l1"] < 0.8 * log[0]["l1"]
    for name in ("adversarial", "discriminator"):
        assert np.ptp([entry[name] for entry in log]) > 0.01
    after = one.learner.judge.parameters()
    assert all(not torch.equal(a, b) for a, b in zip(before, after, strict=True))


def test_the_generators_loss_does_not_teach_the_discriminator(tmp_path):
    one = trainer(tmp_path, "gan")
    given, wanted = (images.float() for images in one._batch(0))
    one.learner.learn(given, wanted, 1e-3)
    grown = [values.grad for values in one.learner.judge.parameters()]
    one.learner.optimizers["judge"].zero_grad()
    one.learner.judge.requires_grad_(False)
    (one.learner.judge(given, one.learner.net(given)).sum()).backward()
    assert all(values.grad is None for values in one.learner.judge.parameters())
    assert all(values is not None for values in grown)


def test_the_first_half_is_at_the_full_rate_and_the_end_at_none(tmp_path, monkeypatch):
    one = trainer(tmp_path, epochs=8.0)
    rates = []
    learn = one.learner.learn

    def watched(given, wanted, rate):
        rates.append(rate)
        return learn(given, wanted, rate)

    monkeypatch.setattr(one.learner, "learn", watched)
    one.run()
    assert len(rates) == 40
    assert rates[:21] == 21 * [2e-3]
    assert np.allclose(np.diff(rates[20:]), -1e-4)
    assert 0 < rates[-1] < 1.1e-4


def test_every_frame_is_learnt_from_once_an_epoch(tmp_path, monkeypatch):
    one = trainer(tmp_path, batch=4)
    seen = []
    square = one.train.square(0, 1.3)
    monkeypatch.setattr(one.train, "square", lambda index, _: (seen.append(index), square)[1])
    for step in range(5):
        one._batch(step)
    assert sorted(seen) == sorted(2 * list(range(10)))
    assert sorted(seen[:10]) == list(range(10))


def test_the_weights_say_how_and_on_what_they_were_trained(tmp_path):
    path = trainer(tmp_path, "gan", epochs=0.4).run()
    net, facts = load_weights(path, GreyNet)
    assert facts["network"] == {
        "arch": "gan",
        "expansion": 1.3,
        "given": "crop",
        "over": "batch",
        "turned": False,
        **TINY,
    }
    assert facts["config"]["epochs"] == 0.4
    assert (facts["steps"], facts["frames"]) == (2, 10)
    assert (facts["worlds"], facts["validation_worlds"]) == ([f"{1:032x}"], [f"{2:032x}"])
    assert facts["seconds"] > 0
    assert 0 < facts["validation"]["nll"] < 2
    assert net.config.arch == "gan"


def test_what_greys_mean_is_fitted_on_cells_not_seen(tmp_path):
    path = trainer(tmp_path, epochs=4.0).run()
    net, facts = load_weights(path, GreyNet)
    free, occupied = net.chances.numpy()
    assert (np.diff(free) >= -1e-6).all()
    assert (np.diff(occupied) <= 1e-6).all()
    assert (free + occupied).max() <= 1.0
    unseen = sum(int((VALIDATION.remembered[i, 35:165, 35:165] == 2).sum()) for i in range(4))
    assert facts["validation"]["cells"] == unseen
    # On what it was fitted on it is calibrated, but for the one cell more of each kind.
    assert facts["validation"]["ece_free"] < 0.02


def test_another_training_in_the_folder_is_not_overwritten(tmp_path):
    trainer(tmp_path).save()
    with pytest.raises(TrainError, match="another config"):
        trainer(tmp_path, rate=1e-3)
    with pytest.raises(TrainError, match="another network"):
        trainer(tmp_path, "mlp")


def test_a_damaged_checkpoint_is_named(tmp_path):
    one = trainer(tmp_path)
    one.save()
    one.checkpoint.write_bytes(one.checkpoint.read_bytes()[:1000])
    with pytest.raises(TrainError, match="cannot be read"):
        trainer(tmp_path)


def test_a_building_is_not_learned_from_and_validated_on(tmp_path):
    with pytest.raises(SplitError, match="both in train and in validation"):
        trainer(tmp_path, validation=generated(4, 1))


@pytest.mark.parametrize("arch", ARCHITECTURES)
def test_twenty_steps_of_the_papers_own_schedule(tmp_path, arch):
    """As published but for the width, on 20 frames of its 200 epochs' millions."""
    paper = PRESETS["paper"]
    assert (paper.width, paper.side, paper.training.batch) == (1.0, 256, 1)
    config = ImageConfig(arch, 1.1, width=1 / 64, side=paper.side)
    training = ImageTraining(**vars(paper.training) | {"epochs": 20 / 10})
    one = ImageTrainer(config, training, TRAIN, VALIDATION, tmp_path)
    assert one.steps == 20
    assert one.run().exists()
    assert len(log_of(tmp_path)) == 20


@pytest.mark.slow(10)
def test_two_steps_of_the_papers_own_u_net(tmp_path):
    """Reduced in nothing but its epochs: 54 million parameters, images of 256 pixels."""
    data, out = tmp_path / "data", tmp_path / "out"
    write_frames(data, {"train": TRAIN, "validation": VALIDATION})
    assert (
        main(
            [
                "--arch",
                "unet_ff",
                "--expansion",
                "1.1",
                "--preset",
                "paper",
                "--epochs",
                "0.2",
                "--data",
                str(data),
                "--out",
                str(out),
                "--jobs",
                "1",
            ]
        )
        == 0
    )
    net, facts = load_weights(out / "unet_ff.safetensors", GreyNet)
    assert facts["steps"] == 2
    assert reduced(facts) == {"epochs": 0.2, "frames": 10}
    assert sum(values.numel() for values in net.parameters()) > 54e6
    first, second = (entry["l1"] for entry in log_of(out))
    assert second < first
    # Half a gigabyte each.
    for path in (out / "checkpoint.pt", out / "unet_ff.safetensors"):
        path.unlink()


def test_a_training_of_before_dropout_was_a_setting_is_still_the_same():
    digests = "train", "validation"
    facts = described(ImageConfig(), ImageTraining(), digests)
    assert facts["config"].keys() == {"epochs", "batch", "rate", "sigma", "brief", "seed"}
    other = described(ImageConfig(), ImageTraining(dropout=0.2), digests)
    assert other["config"] == facts["config"] | {"dropout": 0.2}


def test_two_hundred_epochs_are_what_the_paper_made(tmp_path):
    paper = PRESETS["paper"].training
    assert (paper.epochs, paper.rate, paper.sigma, paper.dropout) == (200, 2e-4, 0.2, 0.5)
    assert trainer(tmp_path, epochs=paper.epochs, batch=paper.batch).steps == 2000


def test_one_command_trains_and_writes_weights(tmp_path, capsys):
    data, out = tmp_path / "data", tmp_path / "out"
    write_frames(data, {"train": TRAIN, "validation": VALIDATION})
    command = [
        "--arch",
        "unet_ff",
        "--expansion",
        "1.5",
        "--preset",
        "short",
        "--width",
        "0.0625",
        "--side",
        "64",
        "--data",
        str(data),
        "--out",
        str(out),
        "--jobs",
        "1",
    ]
    assert main(command) == 0
    path = out / "unet_ff.safetensors"
    assert capsys.readouterr().out.strip() == str(path)
    net, _ = load_weights(path, GreyNet)
    assert (net.config.expansion, net.config.width) == (1.5, 0.0625)
    assert {"checkpoint.pt", "log.jsonl", "curve.png"} <= {each.name for each in out.iterdir()}


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (["--arch", "unet_ff", "--steps", "4"], "--steps is compact's, not unet_ff's"),
        (["--arch", "gan", "--simulated-logs", "1"], "--simulated-logs is compact's, not gan's"),
        (["--epochs", "4"], "--epochs is the paper's networks', not compact's"),
        (["--arch", "gan", "--expansion", "0"], "--expansion is 0"),
        (["--arch", "gan", "--width", "9"], "--width is 9"),
        (["--arch", "mlp", "--epochs", "0"], "--epochs is 0"),
        (["--arch", "mlp", "--sigma", "-1"], "--sigma is -1"),
        (["--arch", "mlp", "--dropout", "1"], "--dropout is 1"),
        (["--arch", "mlp", "--seed", "-1"], "--seed is -1"),
        (["--arch", "mlp", "--batch", "0"], "--batch is 0, it must be at least 1"),
    ],
)
def test_arguments_that_make_no_sense_are_refused(wrong, message, capsys):
    assert main(wrong) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_a_folder_without_frames_is_named(tmp_path, capsys):
    assert main(["--arch", "mlp", "--data", str(tmp_path)]) == 2
    assert str(tmp_path) in capsys.readouterr().err


@pytest.mark.parametrize("given", ["crop", "window"])
def test_it_learns_from_compacts_drives_too(tmp_path, given):
    for split, seed in (("train", 1), ("validation", 2)):
        codes = np.full((3, 280, 280), 8, np.uint8)  # Not seen, never observable.
        frames = generated(3, seed)
        codes[:, 40:240, 40:240] = frames.remembered + 3 * frames.whole
        folder = tmp_path / "drives" / split
        folder.mkdir(parents=True)
        context = bytes(2 * CELLS**2)
        packed = [(zlib.compress(each.tobytes() + context), np.zeros(3)) for each in codes]
        write_samples(folder / "0.npz", packed, {"world": split, "original": split})
    (tmp_path / "drives" / "recipe.json").write_text("{}")
    config = ImageConfig("unet_ff", 1.3, given=given, **TINY)
    planned = tmp_path / "drives" / "planned.json"
    planned.write_text('{"train": 1, "validation": 2}')
    with pytest.raises(TrainError, match="holds 1 of 2 drives"):
        train_images(config, ImageTraining(epochs=1), tmp_path / "drives", tmp_path / "out", 1)
    planned.write_text('{"train": 1, "validation": 1}')
    path = train_images(config, ImageTraining(epochs=1), tmp_path / "drives", tmp_path / "out", 1)
    net, facts = load_weights(path, GreyNet)
    assert net.config.turned
    assert facts["worlds"] == ["train"]
    samples, frames = Samples.load(tmp_path / "drives" / "train"), generated(3, 1)
    for index in range(3):
        of_sample, of_frame = (each.square(index, 1.3) for each in (samples, frames))
        for name in ("crop", "window", "truth"):
            assert np.array_equal(getattr(of_sample, name), getattr(of_frame, name))


def test_what_is_trained_is_left_as_it_is_on_any_number_of_threads(tmp_path, monkeypatch):
    write_frames(tmp_path / "data", {"train": TRAIN, "validation": VALIDATION})
    config = ImageConfig("mlp", 1.3, **TINY)
    training = ImageTraining(epochs=1.0, batch=2)
    out = tmp_path / "out"
    path = train_images(config, training, tmp_path / "data", out, 1)
    before = path.read_bytes(), path.stat().st_mtime_ns
    monkeypatch.setattr("predictor.training.trainer.commit", lambda: "another")
    assert train_images(config, training, tmp_path / "data", out, 2) == path
    assert (path.read_bytes(), path.stat().st_mtime_ns) == before
    with pytest.raises(TrainError, match="trained in another way"):
        train_images(config, ImageTraining(epochs=2.0, batch=2), tmp_path / "data", out, 1)


def test_weights_name_every_commit_that_made_a_step(tmp_path, monkeypatch):
    monkeypatch.setattr("predictor.training.trainer.commit", lambda: "one")
    with pytest.raises(Stopped):
        trainer(tmp_path).run(end=0.0)
    monkeypatch.setattr("predictor.training.trainer.commit", lambda: "two")
    path = trainer(tmp_path).run()
    assert load_weights(path, GreyNet)[1]["commit"] == "one two"
