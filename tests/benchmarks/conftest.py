"""Settings of the tests of benchmarks."""

import pytest


@pytest.fixture(autouse=True)
def without_figures(request, monkeypatch):
    """Only in tests marked `drawn`, a comparison draws figures and writes a page: 2 s each time."""
    if request.node.get_closest_marker("drawn") is None:
        monkeypatch.setattr("benchmarks.figures.run_figures.draw_all", lambda directory: [])
        monkeypatch.setattr("benchmarks.report.report.write_report", lambda run, directory: [])
