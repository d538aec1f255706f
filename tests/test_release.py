"""A release states one version everywhere, and its README has no link that leads nowhere."""

import importlib.util
import re
import tomllib
from pathlib import Path

from foresee.infra.environment import DISTRIBUTION

ROOT = Path(__file__).parents[1]
SPEC = importlib.util.spec_from_file_location("release", ROOT / ".ci/release.py")
release = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(release)
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
LINK = re.compile(r"\[[^]]*\]\(([^)\s]+)\)")


def test_all_files_state_the_same_version():
    assert set(release.versions(ROOT).values()) == {PROJECT["version"]}


def test_the_name_of_the_distribution_is_known_to_the_code():
    assert PROJECT["name"] == DISTRIBUTION


def test_the_index_shows_no_relative_links():
    readme = (ROOT / "README.md").read_text()
    shown = release.for_index(readme, {"version": "1.0.0"})
    assert all(target.startswith("https://") for target in LINK.findall(shown))
    assert "![" not in shown
    assert "*The same" not in shown
    assert len(shown) > 0.7 * len(readme)


def test_links_lead_to_the_repository_if_there_is_one():
    project = {"version": "1.2.3", "urls": {"Repository": "https://example.org/foresee"}}
    text = "![car](docs/a.gif) [page](docs/b.md#c) [below](#d) [web](https://x.org)"
    assert LINK.findall(release.for_index(text, project)) == [
        "https://example.org/foresee/raw/v1.2.3/docs/a.gif",
        "https://example.org/foresee/blob/v1.2.3/docs/b.md#c",
        "https://example.org/foresee/blob/v1.2.3/README.md#d",
        "https://x.org",
    ]
