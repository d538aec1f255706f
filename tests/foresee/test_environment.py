"""The commit of results is this project's, never that of a repository around it."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import foresee

ROOT = Path(foresee.__file__).resolve().parents[1]
IDENTITY = ("-c", "user.name=a", "-c", "user.email=a@b.c")


def git(folder, *words):
    done = subprocess.run(
        ["git", *IDENTITY, *words], cwd=folder, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


def commit(packages, **variables):
    """Return the commit that a copy of the packages records."""
    code = "from foresee.infra.environment import commit; print(commit())"
    # Without installed packages, an editable installation of a checkout is not found.
    done = subprocess.run(
        [sys.executable, "-S", "-c", code],
        cwd=packages,
        env=os.environ | {"PYTHONPATH": ""} | variables,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


@pytest.fixture
def repository(tmp_path):
    """A repository with a copy of the base at its top, and one further down."""
    shutil.copytree(ROOT / "foresee", tmp_path / "foresee")
    shutil.copytree(ROOT / "foresee", tmp_path / "vendor" / "foresee")
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-qm", "all")
    return tmp_path


def test_it_is_that_of_the_repository_whose_top_holds_the_packages(repository):
    head = git(repository, "rev-parse", "HEAD")
    assert commit(repository) == head
    (repository / "foresee" / "checking.py").write_text("")
    assert commit(repository) == f"{head}+"


def test_a_copy_inside_another_repository_has_none(repository):
    assert commit(repository / "vendor") == "None"
    git(repository, "rm", "-rq", "--cached", "foresee")
    git(repository, "commit", "-qm", "no longer tracked")
    assert commit(repository) == "None"


def test_a_hook_of_another_repository_does_not_mislead_it(repository, tmp_path_factory):
    other = tmp_path_factory.mktemp("other")
    git(other, "init", "-q")
    hook = {"GIT_DIR": str(other / ".git"), "GIT_WORK_TREE": str(other)}
    assert commit(repository, **hook) == git(repository, "rev-parse", "HEAD")
