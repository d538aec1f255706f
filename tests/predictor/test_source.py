"""The source of a plug-in: which files its hash covers."""

import hashlib
import sys

import pytest

from benchmarks.race.entry import Entry
from foresee.infra.plug_in import PlugInError
from predictor.source import Source
from predictor.weights import WeightsError

FILES = {
    "my_team/__init__.py": "",
    "my_team/driver.py": "from . import arcs\nfrom .nets.small import Net\nclass Mine: ...\n",
    "my_team/arcs.py": "import numpy\nimport my_tools\nimport planner.navigator\n",
    "my_team/nets/__init__.py": "",
    "my_team/nets/small.py": "class Net:\n    def load(self):\n        import my_team.nets.late\n",
    "my_team/nets/late.py": "from ..driver import Mine\n",
    "my_team/unused.py": "",
    "my_tools.py": "",
    "planner.py": "",
}
COVERED = (
    "my_team/driver.py",
    *("my_team/__init__.py", "my_team/arcs.py", "my_team/nets/__init__.py"),
    *("my_team/nets/late.py", "my_team/nets/small.py", "my_tools.py"),
)


@pytest.fixture
def team(tmp_path, monkeypatch):
    """A folder with a package of a user's, on the path."""
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    for name in [name for name in sys.modules if name.startswith("my_t")]:
        del sys.modules[name]


def test_the_source_of_a_plug_in_is_what_it_imports_from_its_own_folder(team):
    assert Source.of("my_team.driver:Mine").files == COVERED


@pytest.mark.parametrize("name", [*FILES])
def test_a_change_of_a_covered_file_changes_the_fingerprint_of_an_entry(team, name):
    before = Entry.load("driver", "my_team.driver:Mine")
    assert before.sources == COVERED
    (team / name).write_text(FILES[name] + "# changed\n")
    after = Entry.load("driver", "my_team.driver:Mine")
    assert (after.fingerprint != before.fingerprint) == (name in COVERED)


@pytest.mark.parametrize("of", ["Path", "str"])
def test_weights_that_a_driver_names_count(team, of):
    weights = team / "my.onnx"
    (team / "my_tuned.py").write_text(
        f"from pathlib import Path\nclass Learned:\n    weights = {of}({str(weights)!r})\n"
    )
    with pytest.raises(WeightsError, match=r"my\.onnx cannot be read"):
        Entry.load("driver", "my_tuned:Learned")
    weights.write_bytes(b"weights")
    entry, source = Entry.load("driver", "my_tuned:Learned"), Source.of("my_tuned:Learned")
    assert entry.fingerprint == f"{hashlib.sha256(b'weights').hexdigest()} and {source.digest}"


def test_a_module_without_python_code_has_no_source():
    with pytest.raises(PlugInError, match="math is no file of Python code"):
        Source.of("math:hypot")


def test_a_file_that_is_no_python_code_is_named(team):
    (team / "my_team/nets/late.py").write_text("def (")
    with pytest.raises(PlugInError, match=r"late\.py cannot be read: invalid syntax"):
        Source.of("my_team.driver:Mine")
