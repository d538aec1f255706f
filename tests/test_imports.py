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
    *(name for name, _ in commands().values()),
}
"""Modules with imports of our own inside functions: their --help must not wait for what only their
work needs."""


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
    assert done.stdout.startswith("usage: benchmarks.corridor")


def test_the_console_script_lists_its_commands(capsys):
    assert main([]) == 0
    said = capsys.readouterr().out
    assert all(f"  {name} " in said for name in commands())
    assert main(["no-such-command"]) == 2


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
