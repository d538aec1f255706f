"""Mutated files of every kind: a value or the reader's own error, at once, and nothing is lost.

`MUTATIONS=10000 python -m pytest tests/fuzz` tries more of them.
"""

import gzip
import json
import os
import random
import resource
import shutil
import signal
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from zlib import compress

import calibrations
import numpy as np
import pytest
import torch
from drive_results import a_result
from generated_frames import generated, write_frames
from mutations import mutated
from PIL import Image

from benchmarks import tables
from benchmarks.calibration.certificate import conditions_for, load_calibration
from benchmarks.race.ranking import ranking_page, read_entrants
from benchmarks.runs.drive_file import DriveFile
from benchmarks.runs.saved_run import Run
from benchmarks.runs.settings import Settings
from benchmarks.runs.store import Store
from benchmarks.runs.summary import summarise
from benchmarks.runs.summary_text import table, title
from benchmarks.runs.time_optimal import ENTRY, KIND, read_t_opt
from benchmarks.runs.trace import Drive, RunError, Trace
from foresee.infra.command_line import UsageError
from foresee.infra.plain_yaml import YamlError, read_yaml
from foresee.mapping.body import Body
from foresee.mapping.context import CELLS
from planner.risk.calibration import CalibrationError
from predictor.data.carmen import read_carmen
from predictor.data.frames import Frames, FramesError, checksum
from predictor.data.frontier_samples import GOALS, FrontierSamples, write_frontiers
from predictor.data.laser_log import LogError
from predictor.data.log_files import log_sources
from predictor.data.packed_samples import SamplesError
from predictor.data.samples import SIDE, Samples, write_samples
from predictor.networks.compact_net import CompactConfig, CompactNet
from predictor.networks.frontier_net import FrontierConfig, FrontierNet
from predictor.networks.grey_net import GreyNet
from predictor.networks.image_config import ImageConfig
from predictor.training.checkpoint import TrainError, read_checkpoint, write_checkpoint
from predictor.weights import WeightsError, load_weights, read_facts, save_weights
from sim import empty_straight
from sim.map_server import MapError, load_world
from sim.suite import SuiteError
from sim.task_file import TaskFile, TaskFileError

ROOT = Path(__file__).parents[2]
MUTATIONS = int(os.environ.get("MUTATIONS", "200"))
"""Number of mutated files for each reader."""
MOST_SECONDS = 5.0
"""Longest time that a reader may compute [s]."""
MOST_MEMORY = 10**9
"""Memory that a reader may take [bytes]."""
REWRITTEN = (".lock", "settings.json")
"""Files that each command writes anew once it has accepted a folder."""
TWO = Settings(episodes=2, arms=("known",))


@dataclass(frozen=True)
class Reader:
    """A reader, and how a good example of its files is written.

    Attributes:
        write: function that writes good files into an empty folder.
        read: function that reads all that the folder holds.
        errors: exceptions by which the reader refuses files.
        mend: function that makes checksums in the folder right, so that more mutations are read.
        only: endings of the names of the files that are mutated; (): all.
    """

    write: Callable[[Path], object]
    read: Callable[[Path], object]
    errors: tuple[type[Exception], ...]
    mend: Callable[[Path], object] = field(default=lambda folder: None)
    only: tuple[str, ...] = ()


class TooSlow(BaseException):
    """A reader computes for too long."""


@contextmanager
def limited():
    """Stop a reader that computes or waits for too long, or takes too much memory."""

    def stop(*_):
        raise TooSlow

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    handlers = [(kind, signal.signal(kind, stop)) for kind in (signal.SIGPROF, signal.SIGALRM)]
    signal.setitimer(signal.ITIMER_PROF, MOST_SECONDS)
    signal.setitimer(signal.ITIMER_REAL, 20 * MOST_SECONDS)
    # An accident does not take the whole machine.
    limits = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (20 * MOST_MEMORY, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, limits)
        for timer in (signal.ITIMER_PROF, signal.ITIMER_REAL):
            signal.setitimer(timer, 0.0)
        for kind, handler in handlers:
            signal.signal(kind, handler)
    taken = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    assert taken < MOST_MEMORY, f"{taken} bytes"


def read_once(reader, folder):
    """Read files; an error must be the reader's own, of one line."""
    with limited():
        try:
            reader.read(folder)
        except reader.errors as error:
            text = str(error)
            assert text.isprintable()
            assert 0 < len(text) < 1100


def yaml_of(image):
    return (
        f"image: {image}\nresolution: 0.1\norigin: [-1.5, 2.0, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\nmode: trinary\n"
    )


def write_map(folder):
    (folder / "map.yaml").write_text(yaml_of("map.pgm"))
    Image.fromarray(np.arange(240, dtype=np.uint8).reshape(12, 20)).save(folder / "map.pgm")


def write_images(folder):
    shades = np.arange(240, dtype=np.uint8).reshape(12, 20)
    for kind in ("png", "bmp", "tiff", "gif", "jpeg"):
        Image.fromarray(shades).save(folder / f"map.{kind}")
        (folder / f"{kind}.yaml").write_text(yaml_of(f"map.{kind}"))


def read_maps(folder):
    for path in sorted(folder.glob("*.yaml")):
        load_world(path)


def write_log(folder):
    line = "FLASER 180 " + "2.5 " * 180 + "0 0 0 0 0 0 {0}.5 host {0}.5\n"
    (folder / "a.log").write_text("# a comment\nPARAM x 1\n" + line.format(1) + line.format(2))
    sidecar = {"angle_min_deg": -90.0, "angle_inc_deg": 1.0, "no_return_at_or_above_m": 80.0}
    (folder / "a.json").write_text(json.dumps(sidecar))


def write_packed_log(folder):
    write_log(folder)
    (folder / "a.log.gz").write_bytes(gzip.compress((folder / "a.log").read_bytes()))
    (folder / "a.log").unlink()


def read_log(folder):
    path = next(iter(sorted(folder.glob("a.log*"))))
    log_sources([path])
    read_carmen(path)


def write_bag(ros):
    def write(folder):
        from written_bags import Bag

        with Bag(folder / ("site.bag" if ros == 1 else "site"), ros) as out:
            out.mount()
            for time in (1.0, 2.0, 3.0):
                out.transform(time, "map", "base_link", (time, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
                out.scan(time)

    return write


def read_bags(folder):
    from predictor.data.bags import read_bag

    path = folder / "site.bag"
    path = path if path.exists() else folder / "site"
    log_sources([path])
    read_bag(path)


NETS = {
    "compact": (lambda: CompactNet(CompactConfig(5, (2, 2, 2, 2), (1, 1, 1, 1), 1)), CompactNet),
    "quantised": (
        lambda: CompactNet(CompactConfig(5, (2, 2, 2), (1, 1, 1), quantised=True)),
        CompactNet,
    ),
    "frontier": (lambda: FrontierNet(FrontierConfig((2, 2), 2)), FrontierNet),
    "image": (lambda: GreyNet(ImageConfig("unet_ff", width=1 / 64, side=64)), GreyNet),
}


def write_weights(kind):
    def write(folder):
        torch.manual_seed(0)
        facts = {"worlds": ["a"], "validation_worlds": [], "commit": "x", "log": [{"step": 1}]}
        save_weights(folder / "net.safetensors", NETS[kind][0](), facts)

    return write


def read_weights(kind):
    def read(folder):
        read_facts(folder / "net.safetensors")
        load_weights(folder / "net.safetensors", NETS[kind][1])

    return read


def write_training(folder):
    net = GreyNet(ImageConfig("unet_ff", width=1 / 64, side=64))
    optimizer = torch.optim.Adam(net.parameters())
    state = {
        "facts": {"config": {"arch": "x"}, "steps": 3},
        "step": 1,
        "seconds": 2.0,
        "log": [],
        "losses": [[0.5]],
        "commits": ["x"],
        "learner": {"net": net.state_dict(), "optimizer": optimizer.state_dict()},
    }
    write_checkpoint(folder / "checkpoint.pt", state)


def read_training(folder):
    facts = {"config": {"arch": "x"}, "steps": 3}
    read_checkpoint(folder / "checkpoint.pt", facts, torch.device("cpu"))


def a_drive(index):
    """A drive of five ticks that nobody drove, with all arrays of a trace."""
    ticks, arm, rng = 5, "known", np.random.default_rng(index)
    states = np.column_stack([np.arange(ticks + 1), np.zeros((ticks + 1, 2)), np.ones(ticks + 1)])
    own = {
        "states": states,
        "controls": np.zeros((ticks, 2), np.float32),
        "gears": np.ones(ticks, np.int8),
        "plans": np.zeros((ticks, 4, 2), np.float16),
        "limits": np.array([0, 1, 0, 0, 1], np.uint8),
        "limit_names": np.array(["curvature", "top speed"]),
        "emergency": np.zeros(ticks, bool),
        "relied_count": np.array([1, 0, 0, 2, 0], np.int32),
        "relied_cells": np.zeros((3, 2), np.int16),
        "kept": np.array([1, -1, -1, 0, -1], np.int8),
        "times": np.ones((ticks, 2), np.float32),
        "time_names": np.array(["scan", "cycle"]),
        "first_seen": rng.integers(0, ticks, (8, 9)).astype(np.int16),
        "moment_tick": np.array(1),
        "moment_frame": np.array([0.05, 0.0, 0.0]),
        "moment_known": np.zeros((4, 4), np.int8),
        "moment_safe": np.ones((4, 4), bool),
        "moment_plan": np.zeros((4, 4), np.float32),
        "moment_path": np.zeros((3, 2), np.float32),
        "moment_prediction_frame": np.array([0.05, 0.0, 0.0]),
        "moment_p_free": np.zeros((6, 6), np.uint8),
        "moment_p_occupied": np.zeros((6, 6), np.uint8),
        "moment_confidence": np.zeros((6, 6), np.uint8),
    }
    arrays = {f"e{index}/{arm}/{name}": values for name, values in own.items()}
    arrays[f"w{index}/cells"] = np.zeros((8, 9), np.int8)
    arrays[f"w{index}/frame"] = np.array([0.05, -1.0, 2.0])
    arrays[f"w{index}/waypoints"] = np.array([[5.0, 0.0]])
    result = a_result(arm=arm, index=index, world=f"w{index}", seed=index)
    return Drive(result, Trace(Path("nowhere"), index, arm, arrays))


def write_run(folder):
    with Store(folder, TWO, None) as run:
        run.add(a_drive(0))
        run.pack()
        run.add(a_drive(1))


def read_run(folder):
    run = Run.load(folder)
    summary = summarise(run.episodes, tuple(run.arms))
    title(run.settings)
    table(summary, {"predicted": {"sct": None, "time": None}})
    tables.file_tables(tables._read(folder / "results.json"))
    for name in ("v_max", "window", "noise", "dt"):
        run.setting(name)
    for index, arm in run.drives:
        trace = run.trace(index, arm)
        for name in ("states", "distance", "gears", "cusps", "limits", "relied"):
            getattr(trace, name)
        trace.stage_times()
        for name in ("controls", "plans", "kept", "truth", "waypoints", "moment"):
            getattr(trace, name)
        trace.observed(2)


def open_run(folder):
    Store(folder, TWO, None).__exit__()


def write_optimum(folder):
    settings = {"world": ["corridor"], "episodes": 2, "seed": 0, "v_max": 4.0, "braking": 1.5}
    store = DriveFile(folder / "optimum.json", KIND, settings, "episodes", None, ENTRY)
    task = {"seed": 0, "start": [0.0, 1.0, 0.5], "goal": [9.0, 1.0]}
    times = {"t_opt": 3.5, "t_bound": 3.0, "shortest": 9.5}
    for index in range(2):
        store.add({"index": index, "world": f"w{index}"} | task | times)


def read_optimum(folder):
    path = folder / "optimum.json"
    read_t_opt(path, Settings())
    tables._read(path)
    settings = {"world": ["corridor"], "episodes": 2, "seed": 0, "v_max": 4.0, "braking": 1.5}
    shutil.copy(path, folder / "copy.tmp.json")
    DriveFile(folder / "copy.tmp.json", KIND, settings, "episodes", None, ENTRY)


def write_tasks(folder):
    content = {
        "start": [2.0, 1.5, 0.0],
        "goal_radius_m": 1.0,
        "time_limit_s": {"a": 20, "b": 30.5},
        "tasks": [{"map": "a", "goal": [15, 1.5]}, {"map": "b", "goal": [9.0, 1.5]}],
    }
    (folder / "tasks.json").write_text(json.dumps(content))


def read_tasks(folder):
    world = empty_straight(20.0, 3.0)
    for task in TaskFile.read(folder / "tasks.json").tasks:
        task.check_ends(world, Body())


def read_calibration(folder):
    found = load_calibration(folder / "calibration.json")
    found.refuse_other(conditions_for(calibrations.SETTINGS))
    found.level_at(0.05)


def write_set(folder):
    write_frames(folder, {"train": generated(2, 1), "test": generated(1, 2)})


def mend_set(folder):
    path = folder / "manifest.json"
    try:
        manifest = json.loads(path.read_text())
        for facts in manifest["trajectories"]:
            facts["sha256"] = checksum(folder / facts["file"])
    except (ValueError, KeyError, TypeError, OSError):
        return
    path.write_text(json.dumps(manifest))


def read_set(folder):
    frames = Frames.load(folder)
    assert frames.estimated.shape[0] == frames.remembered.shape[0] == len(frames)
    frames.truth(slice(None), 2.0)
    assert frames.worlds
    assert frames.digest


def write_shards(folder):
    good = compress(bytes(SIDE**2 + 2 * CELLS**2))
    about = {"seed": 0, "world": "a", "original": "b", "family": "office"}
    write_samples(folder / "0.npz", [(good, np.zeros(3))] * 2, about)
    write_samples(folder / "1.npz", [(good, np.ones(3))], about)


def read_shards(folder):
    samples = Samples.load(folder)
    for index in range(len(samples)):
        samples[index]
    assert len(samples.family_numbers) == len(samples)
    assert samples.worlds
    assert samples.digest


def write_pictures(folder):
    pictures = np.zeros((2, 3, 80, 80), np.uint8)
    numbers = np.zeros((2, GOALS, 6), np.float32)
    about = {"seed": 0, "world": "a", "family": "office"}
    write_frontiers(folder / "0.npz", list(pictures), list(numbers), [3.0, 4.0], about)


def read_pictures(folder):
    samples = FrontierSamples.load(folder)
    for index in range(len(samples)):
        samples.picture(index)
    assert len(samples.numbers) == len(samples.sizes) == len(samples)


def write_race(folder):
    for name in ("known", "dwa"):
        race = json.loads((ROOT / f"docs/results/race/corridor-v1/{name}.json").read_text())
        race["settings"]["buildings"] = 12
        race["drives"] = race["drives"][:12]
        (folder / f"{name}.json").write_text(json.dumps(race))


def read_race(folder):
    ranking_page(read_entrants(sorted(folder.glob("*.json"))))


READERS = {
    "maps": Reader(write_map, read_maps, (MapError,)),
    "images": Reader(
        write_images, read_maps, (MapError,), only=("png", "bmp", "tiff", "gif", "jpeg")
    ),
    "YAML": Reader(write_map, lambda f: read_yaml(f / "map.yaml", 10_000), (YamlError,)),
    "logs": Reader(write_log, read_log, (LogError,)),
    "packed logs": Reader(write_packed_log, read_log, (LogError,)),
    "bags of ROS 1": Reader(write_bag(1), read_bags, (LogError,)),
    "bags of ROS 2": Reader(write_bag(2), read_bags, (LogError,)),
    **{
        f"weights of {kind}": Reader(write_weights(kind), read_weights(kind), (WeightsError,))
        for kind in NETS
    },
    "checkpoints": Reader(write_training, read_training, (TrainError,)),
    "results": Reader(write_run, read_run, (RunError, UsageError), only=("results.json",)),
    "traces": Reader(write_run, read_run, (RunError, UsageError), only=("traces.npz",)),
    "run folders": Reader(write_run, open_run, (RunError, UsageError)),
    "optimum": Reader(write_optimum, read_optimum, (UsageError,)),
    "race": Reader(write_race, read_race, (UsageError, SuiteError)),
    "tasks": Reader(write_tasks, read_tasks, (TaskFileError,)),
    "calibrations": Reader(
        lambda folder: calibrations.written(folder / "calibration.json"),
        read_calibration,
        (CalibrationError,),
    ),
    "frames": Reader(write_set, read_set, (FramesError,), mend_set),
    "samples": Reader(write_shards, read_shards, (SamplesError,)),
    "frontiers": Reader(write_pictures, read_pictures, (SamplesError,)),
}


def files_in(folder, apart=REWRITTEN):
    return {
        path.relative_to(folder): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in apart
    }


@pytest.mark.parametrize("name", READERS)
def test_mutated_files_are_read_or_refused(name, tmp_path):
    if "bags" in name:
        pytest.importorskip("rosbags")
    reader, rng = READERS[name], random.Random(name)
    folder = tmp_path / "files"
    folder.mkdir()
    reader.write(folder)
    good = files_in(folder, ())
    read_once(reader, folder)
    chosen = [path for path in good if path.name.endswith(reader.only or "")]
    for number in range(MUTATIONS):
        shutil.rmtree(folder)
        for path, content in good.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_bytes(content)
        path = rng.choice(chosen)
        data = mutated(path, good[path], rng)
        (folder / path).write_bytes(data)
        if rng.random() < 0.7:
            reader.mend(folder)
        before = files_in(folder)
        try:
            read_once(reader, folder)
            after = files_in(folder)
            assert all(content in after.values() for content in before.values())
        except BaseException:
            kept = tmp_path / f"mutation-{number}"
            shutil.copytree(folder, kept)
            (kept / path).write_bytes(data)
            print(f"{name}: mutation {number} of {path}: {kept}")
            raise
