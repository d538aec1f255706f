"""Settings of the tests of benchmarks."""

import pytest


@pytest.fixture(autouse=True)
def without_figures(request, monkeypatch):
    """Comparisons draw figures and write a page only in tests marked `drawn`: it takes seconds."""
    if request.node.get_closest_marker("drawn") is None:
        monkeypatch.setattr("benchmarks.figures.run_figures.draw_all", lambda directory: [])
        monkeypatch.setattr("benchmarks.report.report.write_report", lambda run, directory: [])
