"""Files from strangers: any bytes give a value or the reader's own error, and nothing runs."""

import json
import struct
import zlib
from dataclasses import asdict

import numpy as np
import pytest
import torch
from drive_results import a_result
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from safetensors.torch import save

from benchmarks.runs.drive_file import read_drives
from benchmarks.runs.saved_run import Run
from benchmarks.runs.trace import RunError
from foresee.infra.command_line import UsageError
from foresee.infra.plain_yaml import YamlError, read_yaml
from foresee.mapping.context import CELLS
from predictor.compact import of_logs
from predictor.data.carmen import read_carmen
from predictor.data.laser_log import LogError
from predictor.data.packed_samples import SamplesError
from predictor.data.samples import SIDE, Samples, write_samples
from predictor.weights import WeightsError, facts_of
from sim.map_server import MapError, load_world

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
    said_in_one_line(lambda: facts_of(folder / "w.safetensors"), WeightsError)


@pytest.mark.parametrize("facts", ["[" * 100_000, "3", "null", "[]", '{"a": 1e999}'])
def test_facts_of_weights_may_be_anything(folder, facts):
    header = {"architecture": "x", "facts": facts, "fingerprint": "0"}
    (folder / "f.safetensors").write_bytes(save({"w": torch.zeros(2)}, metadata=header))
    said_in_one_line(lambda: facts_of(folder / "f.safetensors"), WeightsError)


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
