"""Kernels are compiled anew when any kernel changes."""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from numba import config

import planner.safety.contact
from foresee.infra.cache_folder import cache_folder
from foresee.mapping.kernels import UNUSED, kept, stamp

ROOT = Path(planner.safety.contact.__file__).resolve().parents[2]


def test_any_kernel_moves_the_stamp_and_nothing_else_does(tmp_path):
    for package in ("foresee", "planner", "predictor", "sim", "benchmarks"):
        shutil.copytree(
            ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("*cache*")
        )
    before = stamp(tmp_path)
    assert before == stamp(ROOT)
    plain = tmp_path / "predictor" / "none.py"
    plain.write_text(plain.read_text() + "# changed\n")
    assert stamp(tmp_path) == before
    for name in ("mapping/body.py", "mapping/context.py"):
        kernel = tmp_path / "foresee" / name
        kernel.write_text(kernel.read_text() + "# changed\n")
        assert stamp(tmp_path) != before
        before = stamp(tmp_path)


def test_what_calls_into_other_files_is_kept_by_the_stamp():
    planner.safety.contact.plan_contact.py_func  # noqa: B018  It is a kernel.
    kept = Path(planner.safety.contact.plan_contact._cache._cache_path)
    assert stamp(ROOT) in str(kept) or not str(config.CACHE_DIR).endswith(stamp(ROOT))


def test_a_place_that_cannot_be_written_keeps_none(tmp_path, monkeypatch):
    assert kept(tmp_path, "a") == tmp_path / "kernels-a"
    (tmp_path / "file").touch()
    assert kept(tmp_path / "file", "a") is None
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    assert kept(tmp_path, "a") is None


def test_kernels_that_none_uses_any_more_go_and_others_stay(tmp_path):
    for name, age in (("old", 1.1), ("recent", 0.9), ("mine", 1.1)):
        folder = kept(tmp_path, name)
        (folder / "kernel.nbi").touch()
        then = folder.stat().st_mtime - age * UNUSED
        os.utime(folder, (then, then))
    (tmp_path / "module.pyc").touch()
    assert kept(tmp_path, "mine") == tmp_path / "kernels-mine"
    assert {path.name for path in tmp_path.iterdir()} == {
        "kernels-recent",
        "kernels-mine",
        "module.pyc",
    }
    assert (tmp_path / "kernels-mine" / "kernel.nbi").exists()


def test_a_package_that_cannot_be_written_keeps_them_in_the_users_cache(tmp_path, monkeypatch):
    package = tmp_path / "foresee"
    mapping = package / "mapping"
    mapping.mkdir(parents=True)
    (package / "__pycache__").touch()
    shutil.copy(ROOT / "foresee" / "mapping" / "kernels.py", mapping)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "user"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    code = "import kernels, numba; print(numba.config.CACHE_DIR)"
    done = subprocess.run([sys.executable, "-c", code], cwd=mapping, capture_output=True, text=True)
    assert done.stdout.strip() == str(cache_folder() / f"kernels-{stamp(tmp_path)}")


NOWHERE = """\
import tempfile

tempfile.tempdir = "/dev/null"
from kernels import njit

@njit(cache=True)
def twice(x):
    return 2 * x

print(twice(3))
"""


def test_without_any_cache_folder_kernels_are_compiled_in_memory_and_one_line_says_so(tmp_path):
    mapping = tmp_path / "foresee" / "mapping"
    mapping.mkdir(parents=True)
    (mapping.parent / "__pycache__").touch()
    shutil.copy(ROOT / "foresee" / "mapping" / "kernels.py", mapping)
    done = subprocess.run(
        [sys.executable, "-c", NOWHERE],
        cwd=mapping,
        env=os.environ
        | {"HOME": "/dev/null", "XDG_CACHE_HOME": "", "NUMBA_CACHE_DIR": "/dev/null"},
        capture_output=True,
        text=True,
    )
    assert done.stdout == "6\n", done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert "no cache folder can be written" in done.stderr


def test_a_temporary_folder_of_another_user_is_no_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", "/dev/null")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    folder = cache_folder()
    assert folder == tmp_path / f"foresee-{os.getuid()}"
    assert folder.stat().st_mode & 0o777 == 0o700
    folder.chmod(0o777)
    assert cache_folder() is None
    folder.rmdir()
    (tmp_path / "elsewhere").mkdir()
    folder.symlink_to(tmp_path / "elsewhere")
    assert cache_folder() is None


def test_a_home_folder_that_is_missing_or_a_relative_cache_folder_is_no_error(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")

    def homeless():
        raise RuntimeError

    monkeypatch.setattr(Path, "home", homeless)
    assert cache_folder() == tmp_path / f"foresee-{os.getuid()}"
