"""Imports lead one way; inside functions there are none of our own but in commands."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import grimp
import pytest

from foresee.__main__ import COMMANDS, commands, main

ROOT = Path(__file__).parents[1]
PACKAGES = ("foresee", "planner", "predictor", "sim", "benchmarks")
BOXES = (
    "foresee.infra",
    "foresee",
    "sim",
    "planner",
    "predictor.networks",
    "predictor.training",
    "predictor.data",
    "predictor.scoring",
    "predictor.recording",
    "predictor.evaluation",
    "predictor",
    "benchmarks.studies",
    "benchmarks",
)
"""The boxes of the drawing, the inner ones first."""
LATE = {
    "foresee.__main__",
    "benchmarks.studies.driver.analysis",
    "predictor.registry",
    *(name for name, _ in commands().values()),
}
"""Modules with imports of our own inside functions: their --help must not wait for what only their
work needs. The registry must not import PyTorch for predictors that run no network."""


def sources():
    """Each module's name and syntax tree."""
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            yield name, ast.parse(path.read_text())


def own(node):
    """Whether a statement imports a module of ours."""
    names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
    names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
    return any(name.split(".")[0] in PACKAGES for name in names)


def test_own_imports_inside_functions_are_those_of_commands():
    found = {
        name
        for name, tree in sources()
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef)
        for node in ast.walk(function)
        if own(node)
    }
    assert found <= LATE


@pytest.mark.parametrize("name", ["sim", "planner", "predictor"])
def test_a_file_that_hides_a_package_is_named_in_a_line(tmp_path, name):
    (tmp_path / f"{name}.py").write_text("")
    command = [sys.executable, "-m", "benchmarks.corridor", "--help"]
    done = subprocess.run(
        command,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        env={"PYTHONPATH": str(ROOT), "PATH": ""},
    )
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert f"{name}.py hides the package {name}" in done.stderr


def test_the_console_script_is_not_misled_by_it(tmp_path):
    for name in PACKAGES:
        (tmp_path / f"{name}.py").write_text("raise RuntimeError")
    code = (
        f"import sys; sys.path[0] = {str(ROOT)!r}; from foresee.__main__ import main; "
        "sys.exit(main(['corridor', '--help']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0
    assert done.stdout.startswith("usage: foresee corridor [options]")


BESIDE = """\
import sys
from importlib.util import find_spec

sys.argv[0] = "/usr/bin/foresee"
from foresee.__main__ import main

try:
    main(["corridor", "--help"])
except SystemExit as ended:
    assert ended.code == 0
import my_module

print("found:", *(find_spec(name).origin for name in ("sim", "planner", "predictor", "benchmarks")))
"""


@pytest.mark.parametrize("kind", ["folder", "file", "package"])
def test_the_command_finds_its_packages_beside_others_of_their_names(tmp_path, kind):
    for name in PACKAGES[1:]:
        if kind == "file":
            (tmp_path / f"{name}.py").write_text("raise RuntimeError")
        else:
            (tmp_path / name).mkdir()
        if kind == "package":
            (tmp_path / name / "__init__.py").write_text("raise RuntimeError")
    (tmp_path / "my_module.py").write_text("")
    done = subprocess.run(
        [sys.executable, "-c", BESIDE],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        env={"PYTHONPATH": str(ROOT), "PATH": ""},
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("usage: foresee corridor [options]")
    assert done.stdout.split("found: ")[1].split() == [
        str(ROOT / name / "__init__.py") for name in ("sim", "planner", "predictor", "benchmarks")
    ]


def test_a_package_of_ones_own_that_hides_one_is_named_in_python(tmp_path):
    (tmp_path / "sim").mkdir()
    (tmp_path / "sim" / "__init__.py").write_text("")
    done = subprocess.run(
        [sys.executable, "-c", "import foresee"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        env={"PYTHONPATH": str(ROOT), "PATH": ""},
    )
    assert done.returncode == 1
    assert "hides the package sim of foresee" in done.stderr.splitlines()[-1]


def test_matplotlib_is_imported_after_what_lets_it_be_imported_in_any_environment():
    # `benchmarks/figures/__init__.py` imports `foresee.infra.drawing` before its modules.
    found = {
        name
        for name, tree in sources()
        for node in tree.body
        if isinstance(node, ast.Import | ast.ImportFrom) and "matplotlib" in ast.unparse(node)
    }
    assert {name.rpartition(".")[0] for name in found} == {"benchmarks.figures"}


def test_the_console_script_lists_its_commands(capsys):
    assert main([]) == 0
    said = capsys.readouterr().out
    assert set(commands()) <= set(said.replace(",", " ").split())
    assert main(["no-such-command"]) == 2
    assert capsys.readouterr().err == "foresee: no command is called 'no-such-command'\n"


def drawn():
    """The arrows of the drawing in docs/explanation/design.md."""
    text = (ROOT / "docs/explanation/design.md").read_text()
    block = re.search(r"```mermaid\n(.*?)```", text, re.DOTALL)[1]
    return set(re.findall(r"^\s*([\w.]+) --> ([\w.]+)$", block, re.MULTILINE))


def package_of(module):
    """The box of the drawing that a module lies in."""
    if module in {home for home, _ in COMMANDS.values()}:
        return "commands"
    return next(box for box in BOXES if module == box or module.startswith(f"{box}."))


def test_the_drawing_of_the_packages_is_true():
    graph = grimp.build_graph(*PACKAGES)
    arrows = {
        (package_of(module), package_of(other))
        for module in graph.modules
        for other in graph.find_modules_directly_imported_by(module)
    }
    # All use the infrastructure; what an arrow of two steps says is not drawn again.
    arrows = {(a, b) for a, b in arrows if a != b and "foresee.infra" not in (a, b)}
    beyond = {(a, c) for a, b in reachable(arrows) for other, c in arrows if other == b}
    assert drawn() == arrows - beyond


def reachable(arrows):
    """All pairs of boxes that one or more arrows lead between."""
    pairs = set(arrows)
    while True:
        longer = {(a, c) for a, b in pairs for other, c in pairs if other == b} - pairs
        if not longer:
            return pairs
        pairs |= longer
