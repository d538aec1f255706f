"""Compiled functions are those that casadi would interpret, and their cache can be trusted."""

import subprocess
import sys
import tempfile
import warnings

import casadi as ca
import numpy as np
import pytest

from foresee.infra.cache_folder import cache_folder
from planner.mpc import codegen
from planner.mpc.codegen import InterpretedWarning, compiled


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)


def function():
    x = ca.SX.sym("x", 3)
    return ca.Function("waves", [x], [ca.gradient(ca.sin(x[0]) * x[1] ** 2 + x[2], x)])


def value(made):
    return np.asarray(made(np.array([0.3, -2.0, 5.0]))).ravel()


def test_it_gives_the_numbers_of_the_interpreter_and_is_kept():
    made = compiled(function())
    assert np.array_equal(value(made), value(function()))
    (library,) = cache_folder().glob("waves-*.so")
    before = library.stat().st_mtime_ns
    assert np.array_equal(value(compiled(function())), value(function()))
    assert library.stat().st_mtime_ns == before
    assert [path.name for path in cache_folder().iterdir()] == [library.name]


def test_another_function_of_the_same_name_is_another_library():
    compiled(function())
    x = ca.SX.sym("x")
    assert float(compiled(ca.Function("waves", [x], [2 * x]))(3)) == 6
    assert len(list(cache_folder().glob("waves-*.so"))) == 2


def test_without_a_compiler_it_is_interpreted_and_says_so(monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.warns(InterpretedWarning, match="no C compiler was found"):
        made = compiled(function())
    assert np.array_equal(value(made), value(function()))


def test_a_compiler_may_come_with_a_launcher_and_options(monkeypatch):
    monkeypatch.setenv("CC", "env cc -O1")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made = compiled(function())
    assert np.array_equal(value(made), value(function()))
    monkeypatch.setenv("CC", " ")
    compiled(function())
    assert len(list(cache_folder().glob("waves-*.so"))) == 2


def test_a_compiler_that_fails_is_quoted(monkeypatch):
    monkeypatch.setattr(codegen, "FLAGS", ("--no-such-flag",))
    with pytest.warns(InterpretedWarning, match="no-such-flag"):
        compiled(function())
    assert not list(cache_folder().glob("*"))


def test_a_cache_that_cannot_be_written_is_replaced_by_a_temporary_one(monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made = compiled(function())
    assert np.array_equal(value(made), value(function()))
    assert len(list(tmp_path.glob("foresee-*/waves-*.so"))) == 1


def test_without_any_cache_it_is_slower_alone(monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "file"))
    with pytest.warns(InterpretedWarning, match="no cache folder can be written"):
        made = compiled(function())
    assert np.array_equal(value(made), value(function()))


def test_a_damaged_library_is_made_again():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        compiled(function())
    (library,) = cache_folder().glob("waves-*.so")
    library.write_bytes(library.read_bytes()[:100])
    code = (
        "import casadi as ca; from planner.mpc.codegen import compiled; x = ca.SX.sym('x', 3);"
        "f = ca.Function('waves', [x], [ca.gradient(ca.sin(x[0]) * x[1] ** 2 + x[2], x)]);"
        "print(compiled(f)([0.3, -2.0, 5.0]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "InterpretedWarning" not in done.stderr
    assert library.stat().st_size > 100


def test_processes_that_start_together_share_the_cache_folder():
    code = (
        "from planner.mpc.mpc import MPC; import warnings; warnings.simplefilter('error'); MPC();"
        "print('ready')"
    )
    both = [
        subprocess.Popen(
            [sys.executable, "-W", "error::UserWarning", "-c", code],
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(2)
    ]
    assert [process.communicate()[0].strip() for process in both] == ["ready", "ready"]
    assert len(list(cache_folder().glob("*stage*.so"))) == 1
