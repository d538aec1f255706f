"""The race: suites are driven, results continued, compared and refused."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import pytest
from calibrations import written
from short_drive import drive, straight

import benchmarks.bench
import benchmarks.rank
import sim.suite
from benchmarks.calibration.certificate import at_risk, conditions_for
from benchmarks.race.entry import Entry
from benchmarks.race.race_drive import race_drive, settings_of
from benchmarks.race.ranking import ranking_page, read_entrants
from benchmarks.runs.drive import drive as compare
from benchmarks.runs.drive_file import DriveFile
from benchmarks.runs.settings import Settings
from foresee.infra.plug_in import load_plug_in
from foresee.infra.workers import WorkersError
from foresee.mapping.car_limits import CarLimits
from sim.controller import ControllerDriver
from sim.episode import Outcome

ROOT = Path(__file__).parents[2]
EXAMPLES = ("examples.stop_and_go:StopAndGo", "examples.dwa:DynamicWindow")
LINE = """\
from foresee.mapping.control import Control

class Slow:
    def __init__(self, mission):
        pass

    def control(self, state, scan, known):
        return Control(-1.5, 0.0)
"""


@pytest.fixture(autouse=True)
def examples_are_found(monkeypatch):
    monkeypatch.syspath_prepend(ROOT)


@pytest.fixture(scope="module")
def two_buildings():
    """A small size of two buildings."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sim.suite, "SMALL", 2)
        yield


def bench(out, *words):
    fixed = ("--suite", "corridor-v1", "--size", "small", "--jobs", "1", "--out", str(out))
    return benchmarks.bench.main([*fixed, *words])


@pytest.fixture(scope="module")
def files(two_buildings, tmp_path_factory):
    """Results of the two examples."""
    folder = tmp_path_factory.mktemp("race")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)
        for name, of in zip(("stop", "dwa"), EXAMPLES, strict=True):
            assert bench(folder / f"{name}.json", "--driver", of, "--name", name) == 0
    return {name: folder / f"{name}.json" for name in ("stop", "dwa")}


def edited(file, path, change):
    """A copy of a file of results, changed."""
    content = json.loads(file.read_text())
    change(content)
    path.write_text(json.dumps(content))
    return path


@pytest.mark.parametrize("spec", EXAMPLES)
def test_an_example_reaches_the_end_of_a_corridor(spec):
    task = straight()
    driver = ControllerDriver(load_plug_in(spec, "driver"), task, CarLimits(), 5.0, True)
    episode = drive(task, driver)
    assert episode.outcome == Outcome.REACHED
    assert episode.max_speed < CarLimits().v_max


def test_a_file_holds_what_is_needed_to_repeat_its_drives(files):
    content = json.loads(files["dwa"].read_text())
    suite = sim.suite.Suite.read("corridor-v1")
    assert content["settings"]["digest"] == suite.digest
    assert content["settings"]["entry"]["of"] == EXAMPLES[1]
    assert content["settings"]["sources"] == ["examples/dwa.py"]
    digest = hashlib.sha256((ROOT / "examples/dwa.py").read_bytes()).hexdigest()
    assert content["settings"]["entry"]["fingerprint"] == digest
    assert content["settings"]["machine"]["packages"]["numpy"]
    for drive_, place in zip(content["drives"], suite.places, strict=False):
        assert (drive_["map"], drive_["seed"]) == (place.map, place.seed)
        assert {"outcome", "time", "commit", "cycle_ms"} <= drive_.keys()


def test_a_finished_file_stays_as_it_is_and_an_unfinished_one_is_continued(files, tmp_path):
    whole = json.loads(files["stop"].read_text())
    half = edited(files["stop"], tmp_path / "half.json", lambda c: c["drives"].pop(0))
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)
        assert bench(half, "--driver", EXAMPLES[0], "--name", "stop") == 0
    again = json.loads(half.read_text())
    for drives in (whole["drives"], again["drives"]):
        for measured in drives:
            measured.pop("cycle_ms")
    assert again == whole


def test_results_of_an_earlier_version_of_a_driver_are_not_continued(
    files, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "slow_driver.py").write_text(LINE)
    words = ("--driver", "slow_driver:Slow", "--name", "stop")
    assert bench(files["stop"], *words) == 2
    assert "other entry: of, fingerprint" in capsys.readouterr().err


def test_the_ranking_orders_the_entries_and_compares_each_two(files, tmp_path, capsys):
    page = tmp_path / "page.md"
    assert benchmarks.rank.main([*map(str, files.values()), "--out", str(page)]) == 0
    text = page.read_text()
    assert capsys.readouterr().out == text
    drives = {name: json.loads(f.read_text())["drives"] for name, f in files.items()}
    best, other = sorted(drives, key=lambda name: -sum(d["sct"] for d in drives[name]))
    rows = [[c.strip() for c in line.split("|")[1:-1]] for line in text.splitlines() if "|" in line]
    assert [row[:2] for row in rows if row[0] in ("1", "2")] == [["1", best], ["2", other]]
    wins = sum(a["time"] < b["time"] for a, b in zip(drives[best], drives[other], strict=True))
    duel = next(row for row in rows if row[:2] == [best, other])
    assert all(d["outcome"] == "reached" for of in drives.values() for d in of)
    assert duel[2] == f"{wins} : {2 - wins}"


def test_an_arm_that_knows_the_true_map_is_named_so(files, tmp_path, capsys):
    entry = {"kind": "arm", "of": "full", "fingerprint": None}
    full = edited(files["stop"], tmp_path / "f.json", lambda c: c["settings"].update(entry=entry))
    assert benchmarks.rank.main([str(full), str(files["dwa"])]) == 0
    assert capsys.readouterr().out.count("(knows the true map)") == 1


def other_map(content):
    content["drives"][1]["map"] = "0" * 32


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c["settings"].update(suite="office-v1"), "only drives in the same buildings"),
        (lambda c: c["settings"].update(digest="0"), "its digest is another"),
        (other_map, "building 1 is another"),
        (lambda c: c["drives"].pop(), "has 1 of 2 drives"),
        (lambda c: c["settings"].update(name="dwa"), "two entries are called 'dwa'"),
        (lambda c: c["settings"].pop("entry"), "it has no proper entry"),
        (lambda c: (c["settings"].update(buildings=0), c["drives"].clear()), "has 0 of 60"),
        (lambda c: c["settings"].update(buildings=10**9), "has 2 of 1000000000 drives"),
        (lambda c: c["settings"].update(machine="fast"), "it has no proper machine"),
        (lambda c: c["drives"][0].pop("time"), "lacks a proper time"),
        (lambda c: c.update(kind="comparison"), "is no file of benchmarks.bench"),
    ],
)
def test_what_cannot_be_compared_is_refused(files, tmp_path, change, message, capsys):
    other = edited(files["stop"], tmp_path / "other.json", change)
    assert benchmarks.rank.main([str(files["dwa"]), str(other)]) == 2
    said = capsys.readouterr()
    assert message in said.err
    assert said.out == ""


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "give one of --predictor, --driver and --arm"),
        (("--arm", "known", "--predictor", "none"), "give one of --predictor, --driver and --arm"),
        (("--arm", "known", "--risk", "0.02"), "--risk needs --predictor"),
        (("--predictor", "none", "--calibration", "c"), "--calibration needs a --risk above 0"),
        (("--predictor", "none", "--uncertified"), "--uncertified needs a --risk above 0"),
        (("--predictor", "none", "--risk", "0.02"), "without a certificate, with --uncertified"),
        (("--predictor", "none", "--risk", "0.02", "--uncertified"), "nor of a mixture"),
        (("--arm", "nobody"), "no arm is called 'nobody'"),
        (("--driver", "examples.dwa:Nobody"), "module examples.dwa has no Nobody"),
        (("--driver", "examples.dwa:AHEAD"), "must be a class or a function"),
        (("--predictor", "nobody"), "no predictor is named 'nobody'"),
    ],
)
def test_what_cannot_drive_is_refused(words, message, tmp_path, capsys):
    assert bench(tmp_path / "out.json", *words) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out.json").exists()


def test_a_risk_gives_the_level_that_a_calibration_certifies(tmp_path, monkeypatch):
    monkeypatch.setattr(DriveFile, "fill", lambda *_: {})
    assert bench(tmp_path / "out.json", "--predictor", "compact", "--risk", "0.02") == 0
    settings = json.loads((tmp_path / "out.json").read_text())["settings"]
    certified = at_risk(Settings(route="fixed", arms=("predicted",), risk=0.02))
    assert settings["level"] == certified.level > 0
    assert (settings["name"], settings["risk"]) == ("compact 2 %", 0.02)
    assert settings["uncertified"] is False
    entry = Entry("predictor", "compact", None, risk=0.02, level=settings["level"])
    drives = settings_of(sim.suite.Suite.read("corridor-v1"), entry, 3)
    assert (drives.risk, drives.level) == (0.02, settings["level"])


def test_a_calibration_in_any_building_of_the_suite_is_refused(tmp_path, capsys):
    entry = Entry("predictor", "none", None)
    conditions = conditions_for(settings_of(sim.suite.Suite.read("corridor-v1"), entry, 0))
    file = written(tmp_path / "c.json", conditions=conditions, seed=900_000_030)
    words = ("--predictor", "none", "--risk", "0.05", "--calibration", str(file))
    assert bench(tmp_path / "out.json", *words) == 2
    assert "same buildings" in capsys.readouterr().err


def test_a_driver_that_is_edited_during_the_race_ends_it():
    before = replace(Entry.load("driver", EXAMPLES[0]), fingerprint="before")
    with pytest.raises(WorkersError, match="StopAndGo has changed"):
        race_drive("corridor-v1", before, 0)


def test_a_risk_without_a_certificate_is_said_in_the_ranking(files, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(DriveFile, "fill", lambda *_: {})
    words = ("--suite", "floor-plans-v1", "--predictor", "compact", "--risk", "0.05")
    assert bench(tmp_path / "out.json", *words) == 2
    assert bench(tmp_path / "out.json", *words, "--uncertified") == 0
    settings = json.loads((tmp_path / "out.json").read_text())["settings"]
    assert settings["level"] > 0
    assert settings["uncertified"] is True

    def at_risk_too(content):
        changes = {"risk": 0.05, "uncertified": True, "calibration": "mine.json"}
        content["settings"] |= changes
        for drive_ in content["drives"]:
            drive_ |= {"uncertified": True, "learned": True}

    capsys.readouterr()
    bold = edited(files["stop"], tmp_path / "bold.json", at_risk_too)
    assert benchmarks.rank.main([str(bold), str(files["dwa"])]) == 0
    page = capsys.readouterr().out
    learned = len(json.loads(bold.read_text())["drives"])
    remark = f"stop (not certified, trained in {learned} of these buildings)"
    assert page.count(remark) == 1
    assert page.count("--risk 0.05 --calibration mine.json --uncertified`") == 1


@pytest.mark.slow(20)
def test_an_arm_drives_as_in_a_comparison(two_buildings, tmp_path):
    entry, suite = Entry.load("arm", "known"), sim.suite.Suite.read("corridor-v1")
    raced = race_drive(suite.name, entry, 1)
    compared = compare(settings_of(suite, entry, 1), 0, "known").result
    assert (raced["outcome"], raced["time"]) == (compared.outcome, compared.time)
    assert (raced["path_length"], raced["sct"]) == (compared.path_length, compared.sct)


def test_the_published_ranking_is_that_of_its_files(monkeypatch):
    monkeypatch.setattr(sim.suite, "SMALL", 12)
    folder = ROOT / "docs/results/race"
    for page in folder.glob("*.md"):
        entrants = read_entrants(sorted((folder / page.stem).glob("*.json")))
        assert page.read_text() == ranking_page(entrants)
