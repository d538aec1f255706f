"""Kernels are compiled anew when any kernel changes."""

import os
import shutil
import subprocess
import sys
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
