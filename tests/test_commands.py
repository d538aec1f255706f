"""Every command tells its usage without what only its work needs."""

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

COMMANDS = {
    "benchmarks.studies.robustness.attack": "benchmarks",
    "benchmarks.studies.robustness.errors": "benchmarks",
    "benchmarks.bench": "benchmarks",
    "benchmarks.calibrate": "benchmarks",
    "benchmarks.corridor": "benchmarks",
    "benchmarks.studies.robustness.interrupt": "benchmarks",
    "benchmarks.optimum": "benchmarks",
    "benchmarks.plot": "benchmarks",
    "benchmarks.rank": "benchmarks",
    "benchmarks.studies.katyal2018.__main__": "predictor",
    "benchmarks.studies.risk.__main__": "benchmarks",
    "benchmarks.studies.performance.__main__": "benchmarks",
    "benchmarks.studies.worth.__main__": "benchmarks",
    "benchmarks.studies.driver.stuck": "benchmarks",
    "benchmarks.tables": "benchmarks",
    "benchmarks.studies.driver.weave": "benchmarks",
    "benchmarks.studies.driver.sweeps": "benchmarks",
    "benchmarks.studies.buildings": "benchmarks",
    "benchmarks.studies.suites": "benchmarks",
    "predictor.check": "predictor",
    "predictor.dataset": "predictor",
    "predictor.drives": "predictor",
    "predictor.evaluate": "predictor",
    "predictor.replay": "predictor",
    "predictor.study": "predictor",
    "predictor.train": "predictor",
    "foresee.completion": "foresee",
    "predictor.train_frontiers": "predictor",
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


@pytest.mark.parametrize("command", COMMANDS)
def test_an_argument_is_shown_escaped_and_on_one_line(command, capsys):
    main = importlib.import_module(command).main
    try:
        status = main(["--\x1b[31mred\a\n\nblue" + "x" * 5000])
    except SystemExit as ended:
        status = ended.code
    said = capsys.readouterr().err
    assert status == 2
    assert said.endswith("\n")
    assert said[:-1].isprintable()
    assert len(said) < 2000


def test_a_reader_that_stops_early_gets_no_complaint():
    folder = Path(__file__).parents[1] / "docs/results"
    # Together, their tables are longer than a pipe's buffer.
    files = [*folder.glob("worth*.json"), *folder.glob("risk*.json"), *folder.glob("stages*.json")]
    command = [sys.executable, "-m", "benchmarks.tables", *map(str, files)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 1
