"""What was measured is kept, and measured again only where it must be."""

import json

from benchmarks.studies.performance import measurements
from benchmarks.studies.performance.measurements import KeptMeasurements, Measurement


def test_a_part_is_measured_once_and_found_by_the_next_run(tmp_path):
    part = Measurement("group/name", {"seed": 0, "shape": (1, 2)}, lambda: {"a": 1.5})
    assert KeptMeasurements(tmp_path / "parts").find(part) is None
    assert KeptMeasurements(tmp_path / "parts").measure(part) == {"a": 1.5}
    assert KeptMeasurements(tmp_path / "parts").find(part) == {"a": 1.5}


def test_other_settings_code_or_machine_count_as_missing(tmp_path, monkeypatch):
    kept = KeptMeasurements(tmp_path)
    kept.measure(Measurement("a", {"seed": 0}, lambda: [1]))
    assert kept.find(Measurement("a", {"seed": 1}, list)) is None
    same = Measurement("a", {"seed": 0}, list)
    with monkeypatch.context() as patch:
        patch.setattr(measurements, "code", lambda: "other")
        assert kept.find(same) is None
    with monkeypatch.context() as patch:
        patch.setattr(measurements, "machine", lambda: {"cores": 64})
        assert kept.find(same) is None
    with monkeypatch.context() as patch:
        patch.setattr(
            measurements, "installed", lambda packages: dict.fromkeys(packages, "another")
        )
        assert kept.find(same) is None
    assert kept.find(same) == [1]


def test_only_packages_that_are_installed_have_a_version():
    assert measurements.installed(["numpy", "no-such-package"]).keys() == {"numpy"}


def test_names_that_look_alike_on_disk_and_broken_files_count_as_missing(tmp_path):
    kept = KeptMeasurements(tmp_path)
    kept.measure(Measurement("a b", {}, lambda: 1))
    assert kept.find(Measurement("a-b", {}, lambda: 2)) is None
    (path,) = tmp_path.iterdir()
    path.write_bytes(path.read_bytes()[:-5])
    assert kept.find(Measurement("a b", {}, lambda: 1)) is None
    path.write_text(json.dumps({"measured": 1}))
    assert kept.find(Measurement("a b", {}, lambda: 1)) is None


def test_a_change_of_the_code_changes_its_fingerprint(tmp_path, monkeypatch):
    for package in measurements.PACKAGES:
        (tmp_path / package).mkdir()
    monkeypatch.setattr(
        measurements,
        "__file__",
        str(tmp_path / "benchmarks" / "studies" / "performance" / "measurements.py"),
    )
    found = set()
    for text in ("a = 1", "a = 2"):
        (tmp_path / "planner" / "mpc.py").write_text(text)
        measurements.code.cache_clear()
        found.add(measurements.code())
    measurements.code.cache_clear()
    assert len(found) == 2
