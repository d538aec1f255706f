"""The package `foresee` offers its names without waiting for what they need."""

import ast
import subprocess
import sys
from pathlib import Path

import foresee

CODE = """\
import sys
before = set(sys.modules)
import foresee
print(*sorted({name.split(".")[0] for name in set(sys.modules) - before}))
"""


def test_the_package_imports_neither_its_neighbours_nor_libraries():
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=True)
    imported = set(done.stdout.split())
    assert "foresee" in imported
    assert imported <= {"foresee"} | set(sys.stdlib_module_names)


def test_the_stub_gives_type_checkers_the_same_names():
    stub = Path(foresee.__file__).with_suffix(".pyi")
    homes = {
        alias.asname: statement.module
        for statement in ast.parse(stub.read_text()).body
        for alias in statement.names
        if alias.asname == alias.name
    }
    assert homes == foresee._HOMES


def test_each_name_is_found_where_it_is_said_to_be():
    for name, home in foresee._HOMES.items():
        assert getattr(foresee, name) is getattr(sys.modules[home], name)
    assert set(foresee.__all__) <= set(dir(foresee))
