"""The documents name only what exists: links, commands, options, paths and names in Python."""

import ast
import importlib
import importlib.util
import re
import shlex
from pathlib import Path

import pytest

from foresee.__main__ import commands

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    [
        *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
        *(ROOT / "docs").rglob("*.md"),
    ]
)
KINDS = ("tutorial", "how-to", "reference", "explanation")
PACKAGES = ("foresee", "sim", "planner", "predictor", "benchmarks")
FOLDERS = (*PACKAGES, "tests", "docs", "examples", "ros2")
"""Folders of the repository; `results` and `data` are those of the reader."""
CARDS = ROOT / "docs/reference/cards"
"""Model cards: they give the commands as they were at the commit of the training."""
GREEK = set("δελσ")
"""Symbols of risk, reliance, level and standard deviation; explanations introduce them."""
FENCE = re.compile(r"^ *```(\w*)\n(.*?)^ *```", re.MULTILINE | re.DOTALL)


def prose(page):
    """The text of a page without its blocks of code."""
    return FENCE.sub("", page.read_text())


def anchors(page):
    """The anchors that GitHub gives to the headings of a page."""
    found = []
    for heading in re.findall(r"^#+ (.*)$", prose(page), re.MULTILINE):
        slug = re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")
        found.append(f"{slug}-{found.count(slug)}" if slug in found else slug)
    return set(found)


def lines_of_commands(page):
    """The shell commands in the blocks of a page, as words; a line ends where no \\ ends it."""
    for language, block in FENCE.findall(page.read_text()):
        if language == "python":
            continue
        for line in block.replace("\\\n", " ").splitlines():
            try:
                yield shlex.split(line, comments=True)
            except ValueError:
                continue  # a drawing or an output


def python_blocks(page):
    """The examples in Python of a page."""
    for language, block in FENCE.findall(page.read_text()):
        if language == "python":
            indent = len(block) - len(block.lstrip(" "))
            yield "\n".join(line[indent:] for line in block.splitlines())


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files_and_headings(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        if target.startswith(("http://", "https://")):
            continue
        name, _, anchor = target.partition("#")
        file = (page.parent / name).resolve() if name else page
        assert file.exists(), target
        assert not anchor or anchor in anchors(file), target


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_modules_and_paths_in_the_text_exist(page):
    text = page.read_text()
    for module in re.findall(r"python -m ([\w.]+)", text):
        if module.split(".")[0] in PACKAGES:
            assert importlib.util.find_spec(module), module
    for path in re.findall(r"`([\w.-]+/[\w./-]*)`", prose(page)):
        if path.split("/")[0] in FOLDERS:
            assert (ROOT / path).exists(), path


def test_commands_have_arguments_that_their_parsers_take():
    modules = {module.removesuffix(".__main__"): name for name, (module, _) in commands().items()}
    for page in PAGES:
        if page.parent == CARDS:
            continue
        for name in re.findall(r"`foresee ([a-z-]+)", prose(page)):
            assert name in commands(), (page.name, name)
        for words in lines_of_commands(page):
            if words[:1] == ["foresee"]:
                name, arguments = words[1], words[2:]
            elif words[:2] == ["python", "-m"] and words[2] in modules:
                name, arguments = modules[words[2]], words[3:]
            else:
                continue
            assert name in commands(), (page.name, name)
            command = importlib.import_module(commands()[name][0]).main
            if arguments != ["--help"]:
                command._parsed(arguments)


def test_a_user_meets_words_and_no_greek_letters(capsys):
    for module, _ in commands().values():
        with pytest.raises(SystemExit):
            importlib.import_module(module).main(["--help"])
        assert not GREEK & set(capsys.readouterr().out), module
    pages = [page for page in PAGES if page.parent.name in ("how-to", "tutorial", ROOT.name)]
    for page in pages:
        assert not GREEK & set(page.read_text()), page.name


def test_examples_in_python_import_names_that_exist():
    for page in PAGES:
        for block in python_blocks(page):
            for node in ast.walk(ast.parse(block)):
                if (
                    not isinstance(node, ast.ImportFrom)
                    or node.module.split(".")[0] not in PACKAGES
                ):
                    continue
                module = importlib.import_module(node.module)
                for alias in node.names:
                    assert hasattr(module, alias.name), (page.name, node.module, alias.name)


def test_the_index_lists_every_page():
    listed = re.findall(r"\]\(([\w/.-]+\.md)\)", (ROOT / "docs/index.md").read_text())
    pages = {
        str(p.relative_to(ROOT / "docs"))
        for kind in KINDS
        for p in (ROOT / "docs" / kind).rglob("*.md")
    }
    assert pages | {"results/README.md"} == set(listed)
    results = {page.name for page in (ROOT / "docs/results").glob("*.md")} - {"README.md"}
    record = (ROOT / "docs/results/README.md").read_text()
    assert all(f"({name})" in record for name in results)


def test_the_readme_is_one_page():
    assert len((ROOT / "README.md").read_text().splitlines()) <= 150
