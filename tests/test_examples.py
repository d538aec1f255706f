"""The examples that learn run to their end, and what they have learned drives."""

import hashlib
from pathlib import Path

import pytest

from benchmarks.race.entry import Entry
from benchmarks.race.race_drive import race_drive
from predictor.evaluation import trial

ROOT = Path(__file__).parents[1]


@pytest.fixture(autouse=True)
def examples_are_found(monkeypatch):
    monkeypatch.syspath_prepend(ROOT)


@pytest.mark.slow(8)
def test_a_network_of_ones_own_is_trained_exported_checked_and_driven_with(
    tmp_path, monkeypatch, capsys
):
    for name in ("onnxscript", "openvino"):
        pytest.importorskip(name, reason="extras: pip install 'foresee-nav[onnx,openvino]'")
    from examples import my_network

    monkeypatch.chdir(tmp_path)
    one = next(trial.tasks())
    monkeypatch.setattr(trial, "tasks", lambda: [one])
    monkeypatch.setattr(trial, "SECONDS", 1.0)
    tiny = "--train 1 --validation 1 --steps 2 --batch 4 --drives 0 --jobs 1"
    # After two steps, the predictions may be bad, but they keep to the contract.
    assert my_network.main(tiny.split()) in (0, 1)
    said = capsys.readouterr().out
    assert "held-out buildings: loss" in said
    assert "examples.my_network:MyNetwork: keeps to the contract" in said


def test_an_agent_learns_and_drives_with_its_saved_policy(tmp_path, monkeypatch, capsys):
    pytest.importorskip("stable_baselines3", reason="an extra: pip install 'foresee-nav[rl]'")
    from examples import learn

    monkeypatch.chdir(tmp_path)
    learn.main(["--steps", "1", "--cars", "1", "--buildings", "1"])
    assert "total_timesteps" in capsys.readouterr().out
    learn.learned.cache_clear()
    entry = Entry.load("driver", "examples.learn:Learned")
    raced = race_drive("corridor-v1", entry, 0)
    assert raced["ticks"] > 10
    assert entry.sources == ("examples/learn.py",)
    digest = hashlib.sha256((tmp_path / "learned.safetensors").read_bytes()).hexdigest()
    assert entry.fingerprint.startswith(digest)
