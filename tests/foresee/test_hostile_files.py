"""Files from strangers: any bytes give a value or the reader's own error, and nothing runs."""

import gzip
import json
import os
import struct
import zipfile
import zlib
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from drive_results import a_result
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from safetensors.torch import save
from short_drive import straight

from benchmarks.calibration.certificate import load_calibration
from benchmarks.runs.drive_file import read_drives
from benchmarks.runs.saved_run import Run
from benchmarks.runs.settings import Settings
from benchmarks.runs.summary_text import title
from benchmarks.runs.time_optimal import read_t_opt
from benchmarks.runs.trace import RunError, Trace
from benchmarks.tables import main as main_of_tables
from foresee.infra.command_line import UsageError
from foresee.infra.plain_yaml import YamlError, read_yaml
from foresee.infra.resumable import ResumableFolder
from foresee.mapping.context import CELLS
from planner.navigator import Navigator
from planner.navigator_config import NavigatorConfig
from planner.risk.calibration import CalibrationError
from predictor.compact import of_logs
from predictor.data.bags import read_bag
from predictor.data.carmen import read_carmen
from predictor.data.frames import Frames, FramesError
from predictor.data.laser_log import LogError
from predictor.data.log_files import log_sources, read_log
from predictor.data.packed_samples import SamplesError
from predictor.data.samples import SIDE, Samples, write_samples
from predictor.networks.compact_net import CompactNet
from predictor.provenance import has_learned
from predictor.training.checkpoint import TrainError, read_checkpoint
from predictor.weights import WeightsError, load_weights, read_facts
from sim.map_server import MapError, load_world
from sim.task_file import TaskFile, TaskFileError

YAML = b"""image: map.pgm
resolution: 0.1
origin: [-1.5, 2.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
PGM = b"P5\n4 3\n255\n" + bytes(range(0, 240, 20))
FLASER = b"FLASER 180 " + b"2.5 " * 180 + b"0 0 0 0 0 0 12.5 host 12.5\n"
SIDECAR = b'{"angle_min_deg": -90, "angle_inc_deg": 1, "no_return_at_or_above_m": 80}'
RESULTS = json.dumps(
    {
        "kind": "optimum",
        "settings": {},
        "summary": {},
        "episodes": [asdict(a_result())],
    }
).encode()
DEEP = b"[" * 100_000


def mutated(good: bytes):
    """Bytes that are good but for a few places, or anything at all."""
    edits = st.lists(
        st.tuples(st.integers(0, len(good)), st.integers(0, 40), st.binary(max_size=12)),
        min_size=1,
        max_size=4,
    )

    def apply(changes):
        data = good
        for at, gone, new in changes:
            data = data[:at] + new + data[at + gone :]
        return data

    return st.one_of(edits.map(apply), st.binary(max_size=200), st.just(DEEP), st.just(b""))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("hostile")


def said_in_one_line(call, error):
    try:
        return call()
    except error as found:
        text = str(found)
        assert text.isprintable()
        assert 0 < len(text) < 1100
        return None


@given(mutated(YAML))
def test_a_map_file_of_any_bytes(folder, data):
    (folder / "map.pgm").write_bytes(PGM)
    (folder / "map.yaml").write_bytes(data)
    said_in_one_line(lambda: load_world(folder / "map.yaml"), MapError)


@given(mutated(PGM))
def test_an_image_of_any_bytes(folder, data):
    (folder / "fuzz.yaml").write_bytes(YAML.replace(b"map.pgm", b"fuzz.pgm"))
    (folder / "fuzz.pgm").write_bytes(data)
    said_in_one_line(lambda: load_world(folder / "fuzz.yaml"), MapError)


@given(mutated(FLASER * 2), mutated(SIDECAR))
def test_a_log_of_any_bytes(folder, log, sidecar):
    (folder / "a.log").write_bytes(log)
    (folder / "a.json").write_bytes(sidecar)
    said_in_one_line(lambda: read_carmen(folder / "a.log"), LogError)


@given(mutated(YAML))
def test_a_bags_metadata_of_any_bytes(folder, data):
    (folder / "metadata.yaml").write_bytes(data)
    said_in_one_line(lambda: read_yaml(folder / "metadata.yaml", 10_000), YamlError)


WEIGHTS = save(
    {"w": torch.zeros(2)}, metadata={"architecture": "x", "facts": "{}", "fingerprint": "0"}
)


@given(mutated(WEIGHTS))
def test_weights_of_any_bytes(folder, data):
    (folder / "w.safetensors").write_bytes(data)
    said_in_one_line(lambda: read_facts(folder / "w.safetensors"), WeightsError)


@pytest.mark.parametrize("facts", ["[" * 100_000, "3", "null", "[]", '{"a": 1e999}'])
def test_facts_of_weights_may_be_anything(folder, facts):
    header = {"architecture": "x", "facts": facts, "fingerprint": "0"}
    (folder / "f.safetensors").write_bytes(save({"w": torch.zeros(2)}, metadata=header))
    said_in_one_line(lambda: read_facts(folder / "f.safetensors"), WeightsError)


@given(mutated(RESULTS))
def test_results_of_any_bytes(folder, data):
    (folder / "results.json").write_bytes(data)
    said_in_one_line(lambda: Run.load(folder), RunError)
    said_in_one_line(lambda: read_drives(folder / "results.json", "optimum"), UsageError)


def shard(path, codes=None, ends=None, about=None):
    """A file of one sample, of which parts are replaced."""
    good = zlib.compress(bytes(SIDE**2 + 2 * CELLS**2))
    write_samples(path, [(good, np.zeros(3))], {"seed": 0, "world": "a", "original": "b"})
    with np.load(path) as file:
        parts = {name: file[name] for name in file.files}
    replaced = {"codes": codes, "ends": ends, "about": about}
    np.savez(path, **(parts | {k: v for k, v in replaced.items() if v is not None}))


@pytest.fixture(scope="module")
def good_shard(folder):
    path = folder / "shards" / "0.npz"
    path.parent.mkdir()
    shard(path)
    return path.read_bytes()


@settings(max_examples=60)
@given(st.data())
def test_a_shard_of_any_bytes(folder, good_shard, data):
    (folder / "shards" / "0.npz").write_bytes(data.draw(mutated(good_shard)))

    def read():
        samples = Samples.load(folder / "shards")
        return [samples[i] for i in range(len(samples))], samples.worlds

    said_in_one_line(read, SamplesError)


@pytest.mark.parametrize(
    "wrong",
    [
        {"ends": np.array([5.5])},
        {"ends": np.array([[1]])},
        {"ends": np.array(["a"])},
        {"ends": np.array([-1])},
        {"ends": np.array([10**9])},
        {"ends": np.array([9, 3])},
        {"codes": np.zeros(3)},
        {"codes": np.array(["x"])},
        {"codes": np.zeros((2, 2), np.uint8)},
        {"codes": np.frombuffer(zlib.compress(bytes([9]) * SIDE**2), np.uint8)},
        {"codes": np.frombuffer(zlib.compress(bytes(500_000_000)), np.uint8)},
        {"about": np.frombuffer(b"[]", np.uint8)},
        {"about": np.frombuffer(DEEP, np.uint8)},
        {"about": np.frombuffer(b'{"format": 1, "side": 280}', np.uint8)},
    ],
    ids=range(14),
)
def test_a_shard_with_fields_of_the_wrong_kind_is_named(tmp_path, wrong):
    if "codes" in wrong and "ends" not in wrong:
        wrong["ends"] = np.array([wrong["codes"].size])
    shard(tmp_path / "0.npz", **wrong)

    def read():
        samples = Samples.load(tmp_path)
        return [samples[i] for i in range(len(samples))]

    with pytest.raises(SamplesError):
        read()


def expanding(depth=30):
    """A map's file whose merge keys expand without end."""
    lines = ["a0: &a0 {x: 1}"]
    lines += [f"a{i}: &a{i} {{<<: [*a{i - 1}, *a{i - 1}]}}" for i in range(1, depth)]
    return ("\n".join(lines) + "\n").encode() + YAML


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (expanding(), "anchors and aliases"),
        (YAML + b"<<: {negate: 1}\n", "merge keys"),
        (YAML.replace(b"0.1", b"1" + b":59" * 60_000), "over 20000 bytes"),
        (YAML.replace(b"0.1", b"1" + b":59" * 3_000), "over 4000 characters"),
        (YAML.replace(b"0.1", b"9" * 3_900), "finite number"),
        (YAML + b"deep: " + b"[" * 5000, "nested"),
        (YAML.replace(b"0.1", b"1e9"), "resolution"),
        (YAML.replace(b"0.1", b"1e-9"), "resolution"),
        (YAML.replace(b"2.0", b"1e9"), "origin"),
        (YAML.replace(b"map.pgm", b"m" * 3_000), "usable image"),
        (YAML.replace(b"map.pgm", b'"\\e[31m\\x07"'), "is not there"),
    ],
    ids=range(11),
)
def test_a_map_file_that_means_harm_is_refused(tmp_path, data, why):
    (tmp_path / "map.yaml").write_bytes(data)
    with pytest.raises(MapError, match=why) as found:
        load_world(tmp_path / "map.yaml")
    assert str(found.value).isprintable()


@pytest.mark.parametrize("suffix", ["png", "pgm", "eps"])
def test_no_image_starts_another_program(tmp_path, monkeypatch, suffix):
    def started(*_, **__):
        raise AssertionError("a program was started")

    monkeypatch.setattr("subprocess.Popen", started)
    name = f"map.{suffix}"
    Image.new("L", (4, 4)).save(tmp_path / "map.eps", "EPS")
    (tmp_path / "map.eps").rename(tmp_path / name)
    (tmp_path / "map.yaml").write_bytes(YAML.replace(b"map.pgm", name.encode()))
    with pytest.raises(MapError, match="usable image"):
        load_world(tmp_path / "map.yaml")


def test_a_png_that_decodes_to_gigabytes_is_refused_before_it_is_decoded(tmp_path):
    def chunk(kind, data):
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    header = struct.pack(">IIBBBBB", 100_000, 100_000, 8, 0, 0, 0, 0)
    png = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", b"") + chunk(b"IEND", b"")
    (tmp_path / "map.pgm").write_bytes(png)
    (tmp_path / "map.yaml").write_bytes(YAML)
    with pytest.raises(MapError, match="pixels"):
        load_world(tmp_path / "map.yaml")


def test_the_published_weights_still_read():
    assert callable(of_logs().predict)


def as_map(folder, path):
    (folder / "here.yaml").write_bytes(YAML.replace(b"map.pgm", path.name.encode()))
    return load_world(folder / "here.yaml")


def as_results(folder, path):
    path.rename(folder / "results.json")
    try:
        return Run.load(folder)
    finally:
        (folder / "results.json").rename(path)


def as_traces(folder, path):
    (folder / "results.json").write_bytes(RESULTS)
    path.rename(folder / "traces.npz")
    try:
        return Run.load(folder).trace(0, "known").states
    finally:
        (folder / "traces.npz").rename(path)


def as_shard(folder, path):
    path.rename(folder / "0.npz")
    try:
        return Samples.load(folder)
    finally:
        (folder / "0.npz").rename(path)


def as_frames(folder, path):
    path.rename(folder / "manifest.json")
    try:
        return Frames.load(folder)
    finally:
        (folder / "manifest.json").rename(path)


def as_settings(folder, path):
    path.rename(folder / "settings.json")
    try:
        return ResumableFolder(folder, {"a": 1})
    finally:
        (folder / "settings.json").rename(path)


def as_lock(folder, path):
    path.rename(folder / ".lock")
    try:
        return ResumableFolder(folder, {"a": 1}, exclusive=True)
    finally:
        (folder / ".lock").rename(path)


CPU = torch.device("cpu")
READERS = {
    "map": (lambda _, path: load_world(path.rename(path.with_suffix(".yaml"))), MapError),
    "image": (as_map, MapError),
    "YAML": (lambda _, path: read_yaml(path, 1000), YamlError),
    "weights": (lambda _, path: load_weights(path, CompactNet), WeightsError),
    "facts": (lambda _, path: read_facts(path), WeightsError),
    "checkpoint": (lambda _, path: read_checkpoint(path, {}, CPU), TrainError),
    "calibration": (lambda _, path: load_calibration(path), CalibrationError),
    "time-optimal drives": (lambda _, path: read_t_opt(path), UsageError),
    "tasks": (lambda _, path: TaskFile.read(path), TaskFileError),
    "results": (as_results, RunError),
    "traces": (as_traces, RunError),
    "samples": (as_shard, SamplesError),
    "frames": (as_frames, FramesError),
    "settings": (as_settings, UsageError),
    "lock": (as_lock, UsageError),
    "log": (lambda _, path: read_log(path), LogError),
    "log's checksum": (lambda _, path: log_sources([path]), LogError),
    "bag": (lambda _, path: read_bag(path), LogError),
}


def make_pipe(path):
    os.mkfifo(path)


def make_device(path):
    path.symlink_to("/dev/zero")


def make_folder(path):
    path.mkdir()


def make_sparse(path):
    with path.open("wb") as file:
        file.truncate(2**43)


@pytest.mark.parametrize("make", [make_pipe, make_device, make_folder, make_sparse])
@pytest.mark.parametrize("name", READERS)
def test_what_is_no_sensible_file_is_refused_at_once(tmp_path, name, make):
    if name == "bag":
        pytest.importorskip("rosbags")
    if name == "log's checksum" and make is make_folder:
        pytest.skip("a folder may be a bag, whose files are hashed")
    read, error = READERS[name]
    path = tmp_path / "x"
    make(path)
    with pytest.raises(error) as found:
        read(tmp_path, path)
    assert str(found.value).isprintable()
    assert 0 < len(str(found.value)) < 1100


def test_a_bag_is_no_folder_of_pipes(tmp_path):
    pytest.importorskip("rosbags")
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: {}")
    os.mkfifo(tmp_path / "x.db3")
    with pytest.raises(LogError, match="no regular file"):
        read_bag(tmp_path)


def test_a_line_of_a_log_is_not_read_without_end(tmp_path):
    with gzip.open(tmp_path / "a.log.gz", "wb", 1) as file:
        for _ in range(20):
            file.write(b"1 " * 2**19)
    with pytest.raises(LogError, match="too long"):
        read_carmen(tmp_path / "a.log.gz")


@pytest.mark.parametrize("wrong", [{}, {"facts": 3}, {"facts": {"a": torch.zeros(3)}}, [1], "x"])
def test_a_checkpoint_of_something_else_is_named(tmp_path, wrong):
    torch.save(wrong, tmp_path / "checkpoint.pt")
    with pytest.raises(TrainError):
        read_checkpoint(tmp_path / "checkpoint.pt", {"a": 1}, CPU)


def test_a_checkpoint_that_is_compressed_is_refused(tmp_path):
    torch.save({"facts": {"a": 1}, "x": torch.zeros(100_000)}, tmp_path / "plain.pt")
    with (
        zipfile.ZipFile(tmp_path / "plain.pt") as plain,
        zipfile.ZipFile(tmp_path / "c.pt", "w", zipfile.ZIP_DEFLATED) as packed,
    ):
        for entry in plain.infolist():
            packed.writestr(entry.filename, plain.read(entry))
    assert read_checkpoint(tmp_path / "plain.pt", {"a": 1}, CPU)
    with pytest.raises(TrainError, match="compressed"):
        read_checkpoint(tmp_path / "c.pt", {"a": 1}, CPU)


ODD = [None, True, "x", [], {}, [[]], [None], float("nan"), float("inf"), 10**400, -(10**400)]


@pytest.mark.parametrize("value", ODD, ids=range(len(ODD)))
def test_a_field_of_the_wrong_kind_is_refused_in_one_line(tmp_path, value):
    good = json.loads(RESULTS)
    fits = {"world", "arm", "outcome", "commit", "vehicle"} if value == "x" else set()
    fits |= {"impact_speed", "t_opt", "t_bound", "sct", "detour", "commit", "shortest_length"}
    fits |= {"hard_stops", "level", "calibrated", "time_limit", "top_speed", "score_speed"}
    fits |= {"published_length", "late_ticks", "late_predictions"}
    flags = {"learned", "uncertified"}
    fits = fits if value in (None, "x") else flags if value is True else set()
    fits |= {"faults", "paths"} if value == {} else set()
    for name in good["episodes"][0]:
        drive = good["episodes"][0] | {name: value}
        (tmp_path / "results.json").write_text(json.dumps(good | {"episodes": [drive]}))
        if name in fits:
            said_in_one_line(lambda: Run.load(tmp_path), RunError)
            continue
        with pytest.raises(RunError, match=name):
            Run.load(tmp_path)
    for name in asdict(Settings()):
        changed = good | {"settings": {name: value}}
        (tmp_path / "results.json").write_text(json.dumps(changed))
        said_in_one_line(lambda: title(Run.load(tmp_path).settings), RunError)
    for name in good:
        changed = good | {name: value}
        (tmp_path / "results.json").write_text(json.dumps(changed))
        said_in_one_line(lambda: Run.load(tmp_path), RunError)
        said_in_one_line(lambda: read_drives(tmp_path / "results.json", "optimum"), UsageError)
        assert main_of_tables([str(tmp_path / "results.json")]) in (0, 2)


@pytest.mark.parametrize("times", [[], [1.0], [1.0, 2.0, 3.0], [1.0, None], {"0": 1.0}])
def test_the_times_of_a_drive_are_two_numbers(tmp_path, times):
    good = json.loads(RESULTS)
    good["episodes"][0]["cycle_ms"] = times
    (tmp_path / "results.json").write_text(json.dumps(good))
    with pytest.raises(RunError, match="cycle_ms"):
        Run.load(tmp_path)


@pytest.mark.parametrize("points", [np.empty((0, 2)), np.empty((0,)), np.ones((2, 3)), np.ones(2)])
def test_a_route_without_points_is_refused(points):
    task = straight()
    with pytest.raises(ValueError, match="waypoints"):
        Navigator(NavigatorConfig(), None, np.array(task.start), task.goal, task.blank(5.0), points)
    trace = Trace(Path("traces.npz"), 0, "known", {"w0/waypoints": points})
    with pytest.raises(RunError, match="waypoints"):
        _ = trace.waypoints


@pytest.mark.parametrize("worlds", [5, None, "abc", {"a": 1}, [["a"]], [5]])
def test_learned_worlds_of_any_kind_are_no_error(worlds):
    predictor = SimpleNamespace(facts={"worlds": worlds})
    assert not has_learned(predictor, [np.zeros((2, 2), np.int8)])
