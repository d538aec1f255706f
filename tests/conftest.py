"""Settings of the test run."""

import pytest
from comparison import run
from hypothesis import settings

from sim import empty_straight, save_world

# The first call of a compiled kernel takes long, and machines that run tests are busy.
settings.register_profile("patient", deadline=None)
settings.load_profile("patient")


def pytest_collection_modifyitems(items):
    """Run slow tests last, and of these the slowest first, so that all workers end together."""

    def rank(item):
        slow = item.get_closest_marker("slow")
        return (0, 0) if slow is None else (1, -next(iter(slow.args), 5))

    items.sort(key=rank)


@pytest.fixture(scope="session")
def short_map(tmp_path_factory):
    """A straight of 20 m as a map_server file."""
    path = tmp_path_factory.mktemp("map") / "straight.yaml"
    save_world(empty_straight(20.0, 3.0), path)
    return path


@pytest.fixture(scope="session")
def narrow(tmp_path_factory):
    """A run of one drive through a narrow building: its folder, and its command."""
    out = tmp_path_factory.mktemp("narrow") / "run"
    command = (
        "--episodes",
        1,
        "--arms",
        "known",
        "--world",
        "narrow",
        "--seed",
        3,
        "--jobs",
        1,
        "--out",
        out,
    )
    assert run(*command) == 0
    return out, command
