"""Every command tells its usage without what only its work needs."""

import subprocess
import sys

import pytest

COMMANDS = {
    "benchmarks.corridor": "benchmarks",
    "benchmarks.optimum": "benchmarks",
    "benchmarks.plot": "benchmarks",
    "benchmarks.prediction.__main__": "predictor",
    "benchmarks.stages": "benchmarks",
    "benchmarks.tables": "benchmarks",
    "predictor.dataset": "predictor",
    "predictor.drives": "predictor",
    "predictor.evaluate": "predictor",
    "predictor.study": "predictor",
    "predictor.train": "predictor",
}
"""Command → the package whose own import it cannot do without."""
CODE = """\
import importlib, sys
importlib.import_module({package!r})
before = set(sys.modules)
try:
    importlib.import_module({command!r}).main(["--help"])
except SystemExit as ended:
    assert ended.code == 0
heavy = {{"casadi", "matplotlib", "numba", "openvino", "scipy", "scipy.ndimage", "scipy.stats",
         "skimage", "torch"}}
print("imported:", *sorted(heavy & (set(sys.modules) - before)))
"""


@pytest.mark.parametrize(("command", "package"), COMMANDS.items())
def test_help_waits_for_nothing_but_the_package(command, package):
    code = CODE.format(command=command, package=package)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("usage: ")
    assert done.stdout.splitlines()[-1].split() == ["imported:"]
