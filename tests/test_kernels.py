"""Kernels are compiled anew when any kernel changes."""

import shutil
from pathlib import Path

from numba import config

import planner.contact
from predictor.kernels import stamp

ROOT = Path(planner.contact.__file__).resolve().parents[1]


def test_any_kernel_moves_the_stamp_and_nothing_else_does(tmp_path):
    for package in ("planner", "predictor", "sim"):
        shutil.copytree(
            ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("*cache*")
        )
    before = stamp(tmp_path)
    assert before == stamp(ROOT)
    plain = tmp_path / "predictor" / "none.py"
    plain.write_text(plain.read_text() + "# changed\n")
    assert stamp(tmp_path) == before
    for name in ("body.py", "data/survey.py"):
        kernel = tmp_path / "predictor" / name
        kernel.write_text(kernel.read_text() + "# changed\n")
        assert stamp(tmp_path) != before
        before = stamp(tmp_path)


def test_what_calls_into_other_files_is_kept_by_the_stamp():
    planner.contact.first_meeting.py_func  # noqa: B018  It is a kernel.
    kept = Path(planner.contact.first_meeting._cache._cache_path)
    assert stamp(ROOT) in str(kept) or not str(config.CACHE_DIR).endswith(stamp(ROOT))
