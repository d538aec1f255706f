"""The site has every page, every public name and every command."""

import argparse
import importlib
import re
import tomllib
from pathlib import Path

import pytest

import foresee
from docs.site.option_list import option_list
from foresee.__main__ import commands

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"


def pages_of(navigation):
    """The pages in a part of the navigation, in their order."""
    if isinstance(navigation, str):
        return [navigation]
    parts = navigation.values() if isinstance(navigation, dict) else navigation
    return [page for part in parts for page in pages_of(part)]


def test_the_navigation_names_every_page_once():
    settings = tomllib.loads((ROOT / "zensical.toml").read_text())["project"]
    pages = {str(page.relative_to(DOCS)) for page in DOCS.rglob("*.md")}
    assert sorted(pages_of(settings["nav"])) == sorted(pages)


@pytest.mark.parametrize(
    "page", sorted(DOCS.rglob("*.md")), ids=lambda page: str(page.relative_to(DOCS))
)
def test_links_of_a_page_lead_to_files_of_the_site(page):
    # The site has only what is in docs, and no lists of the files in a folder.
    for target in re.findall(r"\]\(([^)\s#]+)[^)\s]*\)", page.read_text()):
        if "://" not in target:
            file = (page.parent / target).resolve()
            assert file.is_file(), target
            assert file.is_relative_to(DOCS), target


def test_every_public_name_is_in_the_reference():
    named = re.findall(r"^::: foresee\.(\w+)$", (DOCS / "reference/api.md").read_text(), re.M)
    assert sorted(named) == sorted(foresee.__all__)


def test_every_command_is_in_the_reference():
    page = (DOCS / "reference/options.md").read_text()
    parts = re.findall(r"^#+ (\S+)\n\n```options\nforesee (\S+) --help\n```$", page, re.M)
    assert all(heading == name for heading, name in parts)
    assert sorted(name for _, name in parts) == sorted(commands())


@pytest.mark.parametrize("name", commands())
def test_every_option_of_a_command_is_listed(name):
    parser: argparse.ArgumentParser = importlib.import_module(commands()[name][0]).main.parser()
    listed = option_list(f"foresee {name} --help")
    for action in parser._actions:
        for flag in action.option_strings if action.dest != "help" else ():
            assert f'<dt id="{name}{flag}"><code>{flag}' in listed


@pytest.mark.parametrize("source", ["foresee corridor", "foresee nothing --help"])
def test_a_block_that_names_no_command_is_refused(source):
    with pytest.raises(ValueError, match=re.escape(source)):
        option_list(source)
