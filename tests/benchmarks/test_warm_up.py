"""What is compiled at first use is compiled once, and a command says so."""

from pathlib import Path

import pytest

from benchmarks.runs import warm_up
from foresee.mapping import kernels


@pytest.fixture
def mark(monkeypatch, tmp_path):
    """The mark of an empty cache; the drives of the warm-up are left out."""
    monkeypatch.setattr(kernels, "_FOLDER", str(tmp_path))
    monkeypatch.setattr(warm_up, "_drives", list)
    return kernels.warm_mark()


def test_the_first_command_warms_up_and_the_next_one_does_not(mark, capsys):
    assert not mark.exists()
    warm_up.warm_up_if_cold()
    assert mark.exists()
    assert "compiled" in capsys.readouterr().err
    warm_up.warm_up_if_cold()
    assert capsys.readouterr().err == ""


def test_without_a_cache_nothing_is_warmed_up_for_other_processes(monkeypatch, capsys):
    monkeypatch.setattr(kernels, "_FOLDER", "")
    warm_up.warm_up_if_cold()
    assert capsys.readouterr().err == ""


def test_the_mark_is_another_one_for_other_kernels(mark, monkeypatch):
    monkeypatch.setattr(kernels, "stamp", lambda root: "another")
    assert kernels.warm_mark() != mark


def test_kernels_that_are_compiled_are_counted(mark, capsys):
    @kernels.njit
    def kernel(x):
        return x + 1

    kernel.__module__ = kernel.py_func.__module__ = "planner.motion.path"
    with warm_up._counting(bar := Bar()):
        kernel(1)
        kernel(2)
        kernel(1.0)
    assert bar.n == 1


class Bar:
    n = 0

    def update(self):
        self.n += 1


def test_the_number_of_kernels_is_that_of_the_sources():
    root = Path(kernels.__file__).parents[2]
    lines = [
        line
        for package in kernels.PACKAGES
        for path in (root / package).rglob("*.py")
        for line in path.read_text().splitlines()
    ]
    assert kernels.kernel_count() == sum(line.startswith("@njit") for line in lines)
