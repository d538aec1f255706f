"""Weights are read safely: whatever is wrong with a file, one line says so."""

import json

import pytest
import torch
from safetensors.torch import load, save

from predictor.compact import SHIPPED
from predictor.networks.compact_net import CompactConfig, CompactNet
from predictor.registry import PredictorError, load_predictor
from predictor.weights import WeightsError, load_weights, save_weights


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    torch.manual_seed(0)
    path = tmp_path_factory.mktemp("weights") / "net.safetensors"
    save_weights(path, CompactNet(), {"note": "untrained"})
    return path


def header_of(path):
    data = path.read_bytes()
    length = int.from_bytes(data[:8], "little")
    return json.loads(data[8 : 8 + length])["__metadata__"]


def test_a_network_comes_back_as_it_was(written):
    net, facts = load_weights(written, CompactNet)
    again = load(written.read_bytes())
    assert facts.keys() == {"note", "fingerprint"}
    assert all(torch.equal(again[name], values) for name, values in net.state_dict().items())


def test_what_ships_says_what_it_was_made_of():
    _, facts = load_weights(SHIPPED, CompactNet)
    assert {"config", "samples", "worlds", "commit", "validation"} <= facts.keys()


def test_a_missing_file(tmp_path):
    with pytest.raises(WeightsError, match="does not exist"):
        load_weights(tmp_path / "none.safetensors", CompactNet)


@pytest.mark.parametrize("size", [0, 5, 100, 4000])
def test_a_truncated_file(written, tmp_path, size):
    path = tmp_path / "short.safetensors"
    path.write_bytes(written.read_bytes()[:size])
    with pytest.raises(WeightsError, match="damaged"):
        load_weights(path, CompactNet)


def test_a_file_of_something_else(tmp_path):
    path = tmp_path / "other.safetensors"
    path.write_bytes(save({"a": torch.zeros(3)}))
    with pytest.raises(WeightsError, match="holds weights of None"):
        load_weights(path, CompactNet)


def test_a_pickle_is_not_run(tmp_path):
    path = tmp_path / "evil.safetensors"
    torch.save({"a": torch.zeros(3)}, path)
    with pytest.raises(WeightsError, match="no safetensors file"):
        load_weights(path, CompactNet)


def test_weights_of_another_shape(written, tmp_path):
    path = tmp_path / "wide.safetensors"
    wide = CompactNet(CompactConfig(widths=(16, 32, 56, 64)))
    header = header_of(written)
    path.write_bytes(save(wide.state_dict(), metadata=header))
    with pytest.raises(WeightsError, match=r"tensor .* is"):
        load_weights(path, CompactNet)


@pytest.mark.parametrize(
    "config",
    [
        {"patch": 5, "widths": [], "blocks": []},
        {"patch": 0, "widths": [8, 8], "blocks": [1, 1]},
        {"patch": 5, "widths": [10**9, 8], "blocks": [1, 1]},
        {"patch": 5, "widths": [8, 8], "blocks": [1]},
        {"patch": 5, "widths": "ab", "blocks": [1, 1]},
        {"widths": [8, 8]},
        *(
            {"patch": 5, "widths": [8, 8, 8, 8], "blocks": [1, 1, 1, 1], "context": c, "kinds": k}
            for c, k in ((0, ["a"]), (4, "ab"), (4, ["a", "a"]), (4, [3]), (4, 5))
        ),
        7,
    ],
)
def test_a_header_of_an_impossible_network(written, tmp_path, config):
    path = tmp_path / "odd.safetensors"
    header = header_of(written) | {"config": json.dumps(config)}
    path.write_bytes(save(load(written.read_bytes()), metadata=header))
    with pytest.raises(WeightsError, match="broken header"):
        load_weights(path, CompactNet)


def test_numbers_of_another_kind(written, tmp_path):
    path = tmp_path / "half.safetensors"
    tensors = load(written.read_bytes())
    tensors["head.bias"] = tensors["head.bias"].bfloat16()
    path.write_bytes(save(tensors, metadata=header_of(written)))
    with pytest.raises(WeightsError, match="bfloat16"):
        load_weights(path, CompactNet)


def test_values_that_were_changed(written, tmp_path):
    path = tmp_path / "changed.safetensors"
    tensors = load(written.read_bytes())
    tensors["head.bias"][0] += 1.0
    path.write_bytes(save(tensors, metadata=header_of(written)))
    with pytest.raises(WeightsError, match="not those that were written"):
        load_weights(path, CompactNet)


def test_values_that_are_no_numbers(tmp_path):
    net = CompactNet()
    with torch.no_grad():
        net.head.bias[0] = float("nan")
    path = tmp_path / "nan.safetensors"
    save_weights(path, net, {})
    with pytest.raises(WeightsError, match="not finite"):
        load_weights(path, CompactNet)


def test_a_predictor_with_bad_weights_is_one_line_on_the_command_line(monkeypatch, tmp_path):
    (tmp_path / "bad_weights.py").write_text(
        "from pathlib import Path\n"
        "from predictor.compact import Compact\n"
        "def make():\n"
        "    return Compact(Path('nowhere.safetensors'))\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(PredictorError, match="WeightsError: nowhere"):
        load_predictor("bad_weights:make")
