"""What was measured is kept, and measured again only where it must be."""

from benchmarks.studies.performance import measurements
from benchmarks.studies.performance.measurements import Measurement


def file_of(name, **settings):
    return Measurement(name, settings, list).file


def test_other_settings_code_machine_or_packages_have_another_file(monkeypatch):
    before = file_of("a", seed=0)
    assert file_of("a", seed=0) == before
    assert file_of("a", seed=1) != before
    for name, other in (
        ("code", lambda: "other"),
        ("machine", lambda: {"cores": 64}),
        ("installed", lambda packages: dict.fromkeys(packages, "another")),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(measurements, name, other)
            assert file_of("a", seed=0) != before


def test_names_that_look_alike_on_disk_have_files_of_their_own():
    names = ("a b", "a-b", "a/b")
    assert len({file_of(name) for name in names}) == 3
    assert all(file_of(name).startswith("a-b-") for name in names)


def test_only_packages_that_are_installed_have_a_version():
    assert measurements.installed(["numpy", "no-such-package"]).keys() == {"numpy"}


def test_a_change_of_the_code_changes_its_fingerprint(tmp_path, monkeypatch):
    for package in measurements.PACKAGES:
        (tmp_path / package).mkdir()
    monkeypatch.setattr(
        measurements, "__file__", str(tmp_path / "benchmarks/studies/performance/measurements.py")
    )
    fingerprints = set()
    for text in ("a = 1", "a = 2"):
        (tmp_path / "planner" / "mpc.py").write_text(text)
        measurements.code.cache_clear()
        fingerprints.add(measurements.code())
    measurements.code.cache_clear()
    assert len(fingerprints) == 2
