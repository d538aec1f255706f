"""The simulated set: the paper's numbers, one command, and a kill that loses nothing."""

import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from itertools import pairwise

import numpy as np
import pytest

from foresee.infra.command_line import UsageError
from foresee.mapping.grid import world_hash
from predictor.compact import LOGS, PAPER, SHIPPED
from predictor.data.frames import MANIFEST, Frames, FramesError
from predictor.data.splits import SplitError, check_apart
from predictor.data.squares import truth_codes
from predictor.dataset import main
from predictor.recording import data_sets
from predictor.recording.data_sets import make_simulated, worlds_by_split
from predictor.recording.paper_drives import (
    FIRST_DRIVE,
    FIRST_MAP,
    TRIES,
    SimulatedConfig,
    plan_drives,
)
from predictor.recording.sample_set import DRIVES, EXPLORATIONS
from predictor.recording.settings import DrivesConfig, FrontiersConfig
from predictor.weights import read_facts
from sim.families import generate

SMALL = SimulatedConfig(train=46, test=12, more=1, validation=1, length=10)
ARGUMENTS = ["--train", "46", "--test", "12", "--more", "1", "--validation", "1", "--length", "10"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("set")
    make_simulated(out, SMALL, 1)
    return out


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_the_papers_set_has_the_papers_numbers():
    drives = plan_drives(SimulatedConfig())
    counts = {
        split: [d.count for d in drives if d.split == split] for split in ("train", "test", "more")
    }
    assert (len(counts["train"]), sum(counts["train"])) == (4, 5221)
    assert (len(counts["test"]), sum(counts["test"])) == (2, 1090)
    assert len(counts["more"]) == 20
    assert len({d.map_seed for d in drives if d.split in ("train", "test")}) == 2
    others = [d.map_seed for d in drives if d.split not in ("train", "test")]
    assert len(set(others)) == len(others)
    assert len({d.name for d in drives}) == len(drives)


def test_seeds_are_those_of_nothing_else():
    drives = plan_drives(SimulatedConfig(more=900, validation=900))
    maps = {d.map_seed for d in drives}
    tasks = {d.seed + n for d in drives for n in range(TRIES)}
    assert len(tasks) == TRIES * len(drives)
    assert FIRST_MAP <= min(maps) < max(maps) < FIRST_DRIVE <= min(tasks)
    # Before the samples' first seeds lie those of earlier weights; see predictor.drives.
    assert max(tasks) < DRIVES["train"] - 100_000
    assert min(maps) > DRIVES["validation"] + 100_000
    seeds = ((DrivesConfig(), DRIVES), (FrontiersConfig(), EXPLORATIONS))
    ranges = sorted(
        (first, first + getattr(config, split))
        for config, splits in seeds
        for split, first in splits.items()
    )
    assert all(end <= first for (_, end), (first, _) in pairwise(ranges))


@pytest.fixture(scope="module")
def buildings():
    """Hashes of all buildings of the paper's set."""
    maps = {drive.map_seed for drive in plan_drives(SimulatedConfig())}
    return {world_hash(generate("paper", seed).grid.cells) for seed in maps}


@pytest.mark.parametrize("weights", [SHIPPED, LOGS, PAPER])
def test_shipped_weights_know_none_of_the_buildings(buildings, weights):
    _, facts = read_facts(weights)
    assert len(buildings) == 27
    assert not buildings & {*facts["worlds"], *facts["validation_worlds"]}


def test_frames_are_what_a_drive_through_the_building_sees(folder):
    frames = Frames.load(folder)
    assert len(frames) == 46 + 12 + 10 + 10
    for number, facts in enumerate(frames.about):
        world = generate("paper", facts["map_seed"])
        assert np.array_equal(frames.maps[number], truth_codes(world.grid.free, world.surface))
    truth = frames.truth(slice(None), 2.0)
    for images, there in ((frames.estimated, truth[:, 50:150, 50:150]), (frames.remembered, truth)):
        assert (images[images != 2] == there[images != 2]).all()
        assert 0.05 < (images != 2).mean() < 1.0
    inner = frames.remembered[:, 50:150, 50:150]
    assert np.array_equal(frames.estimated[inner != 2], inner[inner != 2])
    # The car stands in the middle of its squares.
    assert (truth[:, 98:102, 98:102] == 0).all()


def test_the_car_holds_half_a_metre_a_second_and_moves_as_its_actions_say(folder):
    frames = Frames.load(folder)
    assert frames.states[:, 3].max() == pytest.approx(0.5)
    for number in range(len(frames.about)):
        mine = frames.trajectory == number
        states, actions, times = frames.states[mine], frames.actions[mine], frames.times[mine]
        assert times == pytest.approx(0.1 * np.arange(len(times)))
        moved = np.hypot(*np.diff(states[:, :2], axis=0).T)
        mean_speed = 0.5 * (states[1:, 3] + states[:-1, 3])
        assert moved == pytest.approx(0.1 * mean_speed, abs=3e-3)
        wanted = np.clip(states[:-1, 3] + 0.1 * actions[:-1, 0], 0.0, 0.5)
        assert states[1:, 3] == pytest.approx(wanted, abs=1e-6)
        corners = frames.corners[mine] * 0.05 + frames.origins[number][::-1] + 5.0
        assert np.abs(corners[:, ::-1] - states[:, :2]).max() <= 0.0251


def test_a_killed_set_ends_as_if_it_had_not_been(folder, tmp_path, monkeypatch):
    made = []
    make_drive = data_sets.make_drive

    def die(out, config, drive):
        if len(made) == 3:
            raise KeyboardInterrupt
        made.append(drive.name)
        return make_drive(out, config, drive)

    monkeypatch.setattr(data_sets, "make_drive", die)
    with pytest.raises(KeyboardInterrupt):
        make_simulated(tmp_path, SMALL, 1)
    with pytest.raises(FramesError, match="unfinished, it has 3 of 8"):
        Frames.load(tmp_path)
    monkeypatch.setattr(data_sets, "make_drive", make_drive)
    make_simulated(tmp_path, SMALL, 1)
    assert contents(tmp_path) == contents(folder)


@pytest.mark.slow
def test_a_set_killed_without_warning_goes_on(folder, tmp_path):
    command = [
        sys.executable,
        "-m",
        "predictor.dataset",
        "--out",
        str(tmp_path),
        "--jobs",
        "2",
        *ARGUMENTS,
    ]
    process = subprocess.Popen(command, start_new_session=True, stderr=subprocess.DEVNULL)
    try:
        for _ in range(6000):
            if list(tmp_path.glob("*.npz")) or process.poll() is not None:
                break
            time.sleep(0.1)
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    before = set(tmp_path.glob("*.npz"))
    assert before
    assert main(["--out", str(tmp_path), "--jobs", "1", *ARGUMENTS]) == 0
    assert contents(tmp_path) == contents(folder)


def test_another_recipe_in_the_folder_is_refused(folder, capsys):
    before = contents(folder)
    assert main(["--out", str(folder), "--jobs", "1", *ARGUMENTS[:-1], "11"]) == 2
    assert "holds a run with length 10; choose another place" in capsys.readouterr().err
    assert contents(folder) == before


def test_the_manifest_says_how_the_set_was_made(folder):
    manifest = json.loads((folder / MANIFEST).read_text())
    assert manifest["kind"] == "simulated"
    assert manifest["settings"]["train"] == 46
    assert manifest["settings"]["speed"] == 0.5
    assert manifest["version"]
    for facts in manifest["trajectories"]:
        assert {"seed", "map_seed", "commit", "sha256", "world", "count"} <= set(facts)


def test_a_building_in_two_splits_is_refused():
    about = [{"split": split, "world": "a"} for split in ("train", "test")]
    check_apart(worlds_by_split(about))
    with pytest.raises(SplitError, match="1 buildings are both in train and in more"):
        check_apart(worlds_by_split([*about, {"split": "more", "world": "a"}]))


@pytest.mark.parametrize(
    "wrong",
    [
        ["--train", "3"],
        ["--test", "1"],
        ["--more", "-1"],
        ["--jobs", "0"],
        ["--length", "0"],
        ["--log", "nowhere.log"],
        ["--log", ""],
        ["--more", "1000000000000"],
        ["--clutter", "1e300"],
        ["--people", "1e300"],
        ["--noise", "nan"],
        ["--scans", "/scan"],
        ["--clutter", "0.1", "--log", "intel.log"],
    ],
)
def test_arguments_that_make_no_sense_are_refused(wrong, tmp_path, capsys):
    assert main([*wrong, "--out", str(tmp_path / "out")]) == 2
    assert wrong[0] in (said := capsys.readouterr().err) or wrong[1] in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("kind", ["clutter", "noise", "people"])
def test_a_set_may_have_what_the_papers_has_not(folder, tmp_path, kind):
    made = ["--out", str(tmp_path), "--jobs", "1", f"--{kind}", "0.1"]
    assert main(made + ARGUMENTS + ["--more", "0", "--validation", "0"]) == 0
    plain, other = Frames.load(folder, "train"), Frames.load(tmp_path, "train")
    assert not np.array_equal(plain.estimated, other.estimated)
    # What is true changes with what stands there, not with who walks past.
    assert (plain.worlds == other.worlds) == (kind != "clutter")
    truths = [np.stack([f.truth(i, 2.0) for i in (0, 5)]) for f in (plain, other)]
    assert np.array_equal(*truths) == (kind != "clutter")


def test_a_set_with_people_and_noise_comes_out_the_same_again(tmp_path):
    config = dataclasses.replace(SMALL, more=0, validation=0, noise=0.03, people=0.1)
    made = []
    for name in ("one", "other"):
        make_simulated(tmp_path / name, config, 1)
        made.append(contents(tmp_path / name))
    assert made[0] == made[1]


@pytest.mark.parametrize("value", ["-1", "nan", "inf"])
def test_a_variety_that_cannot_be_is_refused(tmp_path, value, capsys):
    assert main(["--out", str(tmp_path), f"--people={value}", *ARGUMENTS]) == 2
    assert "--people" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("split", ["more", "validation"])
def test_there_are_no_more_drives_than_seeds(split):
    assert len(plan_drives(SimulatedConfig(**{split: 1000}))) > 1000
    with pytest.raises(UsageError, match=f"--{split}"):
        SimulatedConfig(**{split: 1001})
