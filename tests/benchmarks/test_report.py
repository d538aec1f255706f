"""The report of a run: its page, its replay in a browser, and its table of episodes."""

import base64
import csv
import json
import re
import shlex
import shutil
import subprocess
import zlib
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import browser
import numpy as np
import pytest
from comparison import run as compare
from drive_results import a_result
from PIL import Image

from benchmarks import plot
from benchmarks.corridor import main as corridor
from benchmarks.figures.animation import roll_out
from benchmarks.figures.intervals import forest, speed_and_collisions
from benchmarks.figures.race import Race, racers
from benchmarks.report.command import command_of
from benchmarks.report.html import inline
from benchmarks.report.replay_data import REASONS, ReplayData
from benchmarks.report.report import LISTS, MOST, report, write_report
from benchmarks.runs.beliefs import BLOCK, CERTAIN
from benchmarks.runs.episodes_csv import COLUMNS, write_episodes
from benchmarks.runs.saved_run import Run
from benchmarks.runs.settings import Settings
from benchmarks.runs.summary import summarise
from benchmarks.runs.summary_text import main_rows
from benchmarks.runs.trace import RunError
from planner.safety.limiting_factor import Limit

ARMS = ("known", "backup", "predicted")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The folder of a run of three arms in one corridor."""
    out = tmp_path_factory.mktemp("report") / "run <1>"
    words = ("--seed", 36, "--episodes", 1, "--arms", ",".join(ARMS), "--route", "fixed")
    assert compare(*words, "--predictor", "distance", "--jobs", 1, "--out", out) == 0
    return out


@pytest.fixture(scope="module")
def run(folder):
    return Run.load(folder)


class Page(HTMLParser):
    """The texts of a page: tables, by cell, and elements with an id; and the addresses in it."""

    def __init__(self, text):
        super().__init__()
        self.tables, self.texts, self.addresses, self.open = [], {}, [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.addresses += [v for k, v in attributes if k in ("src", "href", "xlink:href", "action")]
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self.tables[-1][-1].append("")
        self.open.append((tag, given.get("id")))

    def handle_endtag(self, tag):
        while self.open and self.open.pop()[0] != tag:
            pass

    def handle_data(self, text):
        if any(tag in ("td", "th") for tag, _ in self.open):
            self.tables[-1][-1][-1] += text
        for _, name in self.open:
            if name is not None:
                self.texts[name] = self.texts.get(name, "") + text


@pytest.fixture(scope="module")
def page(folder):
    return Page((folder / "report.html").read_text())


def unpacked(text, kind):
    return np.frombuffer(zlib.decompress(base64.b64decode(text)), kind)


def metres_per_second(text):
    number, unit = text.split()
    assert unit == "m/s"
    return float(number)


def rounded(speed):
    """A speed, as it is shown with two digits."""
    return pytest.approx(speed, abs=0.0056)


def test_the_table_of_the_page_is_that_of_the_run(page, run):
    shown = [[inline(c) for c in row] for row in main_rows(summarise(run.episodes, ARMS))]
    assert page.tables[0] == [[re.sub("<[^>]+>", "", cell) for cell in row] for row in shown]
    assert "`" not in page.texts["words"]
    ratio = summarise(run.episodes, ARMS)["backup"]["time_ratio"]["value"]
    assert f"backup (no network) {ratio:.2f}" in page.texts["words"]


def test_the_page_needs_no_other_file_and_no_network(page, folder):
    assert all(address.startswith("#") for address in page.addresses)
    text = (folder / "report.html").read_text()
    assert "default-src 'none'" in text
    assert not re.findall(r"@import|url\((?!#)|fetch\(|XMLHttpRequest|import\(", text)


def test_the_slowest_drive_is_listed_first_with_a_link_to_its_replay(page, run):
    slowest = min(run.episodes, key=lambda r: r.sct)
    listed = next(table for table in page.tables if table[0][0] == "episode")
    assert listed[1][:5] == ["0", slowest.world, slowest.arm, "reached", f"{slowest.time:.1f}"]
    assert f"#drive=0&arm={slowest.arm}" in page.addresses


def test_lists_hold_what_they_say_and_the_worst_first():
    drives = [
        a_result(index=0, outcome="collided", impact_speed=1.0),
        a_result(index=1, outcome="collided", impact_speed=2.0),
        a_result(index=2, outcome="stuck", path_length=7.0),
        a_result(index=3, outcome="timed_out", path_length=3.0),
        a_result(index=4, promises=100, promises_broken=1, sct=0.5),
        a_result(index=5, promises=10, promises_broken=1, sct=0.4),
    ]
    found = [[drive.index for drive in each.of(drives)] for each in LISTS]
    assert found == [[1, 0], [3, 2], [5, 4], [5, 4]]


def test_the_embedded_arrays_are_those_of_the_trace(page, run):
    data = json.loads(page.texts["data"])
    assert [drive["arm"] for drive in data["drives"]] == list(ARMS)
    (episode,) = data["episodes"]
    assert json.loads(json.dumps(episode["goal"])) == run.episodes[0].goal
    for drive in data["drives"]:
        trace = run.trace(0, drive["arm"])
        states = unpacked(drive["states"], "<i4").reshape(-1, 4) / [1e3, 1e3, 1e4, 1e3]
        np.testing.assert_allclose(states, trace.states, atol=6e-4)
        names = [drive["limit_names"][k] for k in unpacked(drive["limits"], "<u1")]
        assert names == trace.limits
        ticks = len(names)
        for name in ("plans", "last_resorts"):
            points = unpacked(drive[name], "<i2").reshape(ticks, -1, 2) / 100
            rolled = roll_out(trace.states[:-1], trace.read(name), 0.1)[:, ::2, :2]
            np.testing.assert_allclose(points + trace.states[:-1, None, :2], rolled, atol=6e-3)
        # A cell is shown from the tick in which a part of it was first observed.
        seen = unpacked(drive["first_seen"], "<u2").reshape(episode["shape"])
        corner = run.trace(0, "known").truth.frame.cell(
            *(np.array(episode["origin"]) + 0.5 * episode["cell"] / episode["factor"])
        )
        for row, col in np.argwhere(seen > 0)[::997]:
            top, left = np.array(corner) + episode["factor"] * np.array([row, col])
            block = trace.first_seen[top : top + episode["factor"], left : left + episode["factor"]]
            assert seen[row, col] == block[block > 0].min()
        assert seen.max() == trace.first_seen.max()
    beliefs = unpacked(data["drives"][2]["beliefs"], "<i1")
    assert np.array_equal(beliefs, run.trace(0, "predicted").read("beliefs").ravel())
    assert "beliefs" not in data["drives"][0]


def test_a_belief_lies_where_the_prediction_was(run):
    trace = run.trace(0, "predicted")
    moment = trace.moment
    free, occupied, confidence = moment.prediction
    values, frame = trace.belief(moment.tick)
    xs, ys = frame.centres()
    checked = 0
    for row, y in enumerate(ys):
        for col, x in enumerate(xs):
            # The centre is a corner of the small cells.
            top, left = np.array(moment.frame.cell(x + 0.025, y + 0.025)) - BLOCK // 2
            block = np.s_[top : top + BLOCK, left : left + BLOCK]
            if top < 0 or left < 0 or free[block].shape != (BLOCK, BLOCK):
                continue
            mean = (confidence[block] * (free[block] - occupied[block])).mean()
            assert values[row, col] == pytest.approx(mean, abs=0.6 / CERTAIN)
            checked += 1
    assert checked > 2000


def test_no_more_episodes_are_embedded_than_fit_and_the_page_says_so(run):
    two = replace(
        run,
        episodes=[*run.episodes, *(replace(e, index=1) for e in run.episodes)],
        arrays=dict(run.arrays)
        | {
            name.replace("0/", "1/", 1): values
            for name, values in run.arrays.items()
            if name[1:3] == "0/"
        },
    )
    both = ReplayData(two, [1, 0], MOST)
    assert both.indices == {0, 1}
    size = len(json.dumps([both.episodes, both.drives]))
    assert ReplayData(two, [1, 0], size - 10).indices == {1}
    assert ReplayData(two, [1, 0], 10).indices == set()


def test_a_trace_that_cannot_be_shown_is_refused(run):
    far = np.array(run.arrays["e0/known/states"])
    far[5, 0] = 1e8
    arrays = dict(run.arrays) | {"e0/known/states": far}
    with pytest.raises(RunError, match="a trace holds"):
        report(replace(run, arrays=arrays))


def test_an_arm_without_a_last_resort_shows_none(run):
    arrays = {k.replace("/backup/", "/optimistic/"): v for k, v in run.arrays.items()}
    episodes = [replace(e, arm=e.arm.replace("backup", "optimistic")) for e in run.episodes]
    data = ReplayData(replace(run, arrays=arrays, episodes=episodes), [0], MOST)
    shown = {drive["arm"]: "last_resorts" in drive for drive in data.drives}
    assert shown == {"known": True, "optimistic": False, "predicted": True}


def test_a_report_of_a_run_without_embedded_drives_has_no_links(run, monkeypatch):
    monkeypatch.setattr("benchmarks.report.report.MOST", 10)
    text = report(run)
    assert "0 of 3 drives" in text
    assert 'href="#drive=' not in text


@pytest.mark.parametrize(
    "words",
    [
        "--arms known,backup",
        "--arms predicted,known --risk 0 0.02 --episodes 3",
        "--arms known --world office corridor --route fixed --seed 7 --v-max 2.5 --noise 0.01",
        "--arms known --car f1tenth --start -1 2.5 0 --goal 6 1.5 --episodes 2",
        "--arms predicted --fixed-level --level 0.02 --expansion 1.5",
        "--arms known --start 1 2 -0.00001 --goal 6 1.5",
    ],
)
def test_the_command_of_a_report_gives_the_settings_of_the_run(words, run):
    def settings_of(line):
        settings, risks, _ = corridor._parsed(shlex.split(line)[2:])
        return settings, risks.risk

    given, risks = settings_of(f"foresee corridor {words}")
    arms = [f"predicted {100 * r:g} %" for r in risks if r] + list(given.arms)
    saved = json.loads(json.dumps(vars(replace(given, arms=tuple(arms)))))
    again, same_risks = settings_of(command_of(replace(run, settings=saved)))
    assert sorted(same_risks) == sorted(risks)
    assert set(again.arms) == set(given.arms)
    assert replace(again, arms=("known",)) == replace(given, arms=("known",))


def test_the_command_of_a_report_needs_no_file_of_the_car(run):
    saved = run.settings | {"car": "/gone/car.yaml", "v_max": Settings.v_max}
    line = command_of(replace(run, settings=saved))
    assert "--car /gone/car.yaml" in line
    # The default of the car's file is not known.
    assert f"--v-max {Settings.v_max}" in line


def test_forest_and_collisions_draw_the_intervals_of_the_summary():
    drives = [
        a_result(arm=arm, index=k, world=f"w{k}", time=time + 0.1 * k, sct=0.5, mean_speed=2.0)
        for arm, time in (("known", 10.0), ("predicted", 8.0))
        for k in range(24)
    ]
    summary = summarise(drives, ("known", "predicted"))
    ratio = summary["predicted"]["time_ratio"]
    left = forest(summary).axes[0]
    (bar,) = [c for c in left.collections if c.get_segments()]
    (low, _), (high, _) = bar.get_segments()[0]
    assert (low, high) == pytest.approx((ratio["low"], ratio["high"]))
    ends = [100 * end for end in summary["known"]["collided_interval"]]
    assert ends[1] > 5
    bars = [c.get_segments()[0] for c in speed_and_collisions(summary).axes[0].collections]
    assert any(bar[:, 1] == pytest.approx(ends) for bar in bars)


def test_every_limit_is_explained():
    assert set(REASONS) == {str(limit) for limit in Limit}


def test_episodes_csv_has_the_results_of_each_drive(folder, run):
    with (folder / "episodes.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == list(COLUMNS)
    assert len(rows) == len(run.episodes)
    for row, result in zip(rows, run.episodes, strict=True):
        assert (row["arm"], row["building"], row["outcome"]) == (
            result.arm,
            result.world,
            result.outcome,
        )
        assert int(row["episode"]) == result.index
        assert float(row["time_s"]) == result.time
        assert float(row["sct"]) == result.sct
        assert float(row["goal_y_m"]) == result.goal[1]
        assert row["impact_speed_m_per_s"] == ""


def test_a_name_with_a_comma_or_a_quote_survives_in_episodes_csv(tmp_path):
    path = write_episodes([a_result(world='a, "b"\nc')], tmp_path)
    with path.open(newline="") as file:
        assert next(csv.DictReader(file))["building"] == 'a, "b"\nc'


@pytest.mark.drawn
def test_plot_writes_report_and_race_of_a_saved_run(folder, tmp_path, monkeypatch):
    monkeypatch.setattr("benchmarks.figures.race.MOST", 12)
    assert (
        plot.main([str(folder), "--report", "--race", "--format", "gif", "--out", str(tmp_path)])
        == 0
    )
    assert {path.name for path in tmp_path.iterdir()} >= {"report.html", "episodes.csv"}
    gif = tmp_path / "race-0.gif"
    # Of 3 MB for ten times as many frames, though the first one is larger than the others.
    assert gif.stat().st_size < 3e5
    with Image.open(gif) as race:
        assert 10 <= race.n_frames <= 13


def test_in_a_race_a_clock_stops_when_its_car_arrives(run):
    race = Race(run, 0)
    first, last = race.frame(0), race.frame(len(race) - 1)
    assert np.abs(first.astype(int) - last).max() > 100
    times = [run.drives[0, arm].time for arm in ARMS]
    assert clocks(race) == [(f"{time:.1f} s", "reached") for time in times]
    race.frame(20)
    tick, state = race.ticks[20], run.trace(0, "backup").states[race.ticks[20]]
    assert clocks(race)[1] == (f"{0.1 * tick:.1f} s", f"{state[3]:.1f} m/s")


def clocks(race):
    """What stands at the right of each panel's head."""
    return [(panel._clock.get_text(), panel._speed.get_text()) for panel in race._views]


def test_of_several_risks_the_highest_races(run):
    drives = [replace(e, arm=f"predicted {k:g} %") for e in run.episodes for k in (2, 10)]
    assert racers(replace(run, episodes=[*run.episodes, *drives]), 0) == [
        "known",
        "backup",
        "predicted 10 %",
    ]


def test_a_race_needs_two_of_its_arms(run):
    alone = replace(run, episodes=[e for e in run.episodes if e.arm == "known"])
    with pytest.raises(RunError, match="two of the arms known, backup, predicted"):
        Race(alone, 0)


@pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")
def test_the_script_of_the_page_says_what_the_trace_holds(folder, run):
    wanted = [(arm, tick) for arm in ARMS for tick in (0, 37, 70, 10**6)]
    hashes = [f"#drive=0&arm={arm}&tick={tick}" for arm, tick in wanted]
    words = ["node", Path(browser.__file__).with_name("replay_in_node.js"), folder / "report.html"]
    done = subprocess.run([*words, *hashes], capture_output=True, text=True, check=True)
    for (arm, tick), said in zip(wanted, json.loads(done.stdout), strict=True):
        trace = run.trace(0, arm)
        last = len(trace.limits)
        limit = trace.limits[min(tick, last - 1)]
        assert metres_per_second(said["speed"]) == rounded(trace.states[min(tick, last), 3])
        assert said == {
            "clock": f"{min(tick, last) / 10:.1f} s",
            "speed": said["speed"],
            "limit": limit,
            "reason": REASONS[limit],
            "outcome": "reached" if tick > last else "",
            "arm": arm,
        }


@pytest.fixture(scope="module")
def window():
    if why := browser.missing():
        pytest.skip(why)
    opened = browser.Browser()
    yield opened
    opened.close()


def shown(window, *names):
    return [
        window.run("return document.getElementById(arguments[0]).textContent", n) for n in names
    ]


def opened(window, folder, hash_):
    # A page that is open already would only be told of a new fragment.
    window.open("about:blank")
    window.open((folder / "report.html").as_uri() + hash_)
    window.wait("return document.getElementById('clock').textContent")


@pytest.mark.slow
def test_the_replay_shows_the_tick_of_the_drive_that_the_address_names(window, folder, run):
    for arm, tick in (("backup", 40), ("predicted", 61)):
        opened(window, folder, f"#drive=0&arm={arm}&tick={tick}")
        trace = run.trace(0, arm)
        clock, speed, limit, outcome = shown(window, "clock", "speed", "limit", "outcome")
        assert clock == f"{tick / 10:.1f} s"
        assert metres_per_second(speed) == rounded(trace.states[tick, 3])
        assert (limit, outcome) == (trace.limits[tick], "")
        assert shown(window, "reason") == [REASONS[limit]]
        assert window.run("return document.getElementById('arm').value") == arm
    assert window.errors() == []


@pytest.mark.slow
def test_keys_and_slider_move_the_replay_and_space_plays_it(window, folder, run):
    opened(window, folder, "#drive=0&arm=known&tick=10")
    for keys, tick in (
        (["right"], 11),
        (["shift", "right"], 21),
        (["left"], 20),
        (["home"], 0),
        (["end"], len(run.trace(0, "known").plans)),
    ):
        window.press(*keys)
        assert shown(window, "clock") == [f"{tick / 10:.1f} s"]
    assert shown(window, "outcome") == ["reached"]
    assert shown(window, "clock") == [f"{run.drives[0, 'known'].time:.1f} s"]
    window.run(
        "const time = document.getElementById('time'); time.value = 33;"
        "time.dispatchEvent(new Event('input'));"
    )
    assert shown(window, "clock") == ["3.3 s"]
    window.press(" ")
    assert shown(window, "play") == ["Pause"]
    window.wait("return document.getElementById('clock').textContent > '3.4 s'")
    window.press(" ")
    assert shown(window, "play") == ["Play"]


@pytest.mark.slow
def test_the_map_shows_what_was_observed_and_believed(window, folder, run):
    opened(window, folder, "#drive=0&arm=predicted&tick=50")
    trace = run.trace(0, "predicted")
    episode = json.loads(Page((folder / "report.html").read_text()).texts["data"])["episodes"][0]
    # The canvas of the building, read where a cell was observed free at first and at the end.
    frame, truth = trace.truth.frame, trace.truth.cells

    def colour(cells):
        x, y = frame.centre(*cells)
        at = (np.array([x, y]) - episode["origin"]) / (
            np.array(episode["shape"])[::-1] * episode["cell"]
        )
        return window.run(
            "const c = document.getElementById('far'), p = c.getContext('2d');"
            "const at = arguments[0];"
            "const w = c.width, h = w * arguments[1];"
            "return [...p.getImageData(at[0] * w, c.height - at[1] * h, 1, 1).data].slice(0, 3);",
            at.tolist(),
            episode["shape"][0] / episode["shape"][1],
        )

    def whole(mask):
        """Cells of which all neighbours are alike, too, and which no line crosses."""
        from scipy.ndimage import binary_erosion

        return binary_erosion(mask, iterations=6)

    near = np.hypot(*(np.array(np.meshgrid(*frame.centres())) - trace.states[50, :2, None, None]))
    first = trace.first_seen
    seen = whole((first > 0) & (first <= 51) & (truth == 0)) & (near > 4) & (near < 8)
    driven = np.zeros_like(seen)
    for x, y in trace.states[:, :2]:
        row, col = frame.cell(x, y)
        driven[row - 8 : row + 9, col - 8 : col + 9] = True
    later = whole((first > 80) & (truth == 0)) & (near > 9)
    assert colour(np.argwhere(seen & ~driven)[0]) == [255, 255, 255]
    assert colour(np.argwhere(later)[0]) == [217, 217, 217]
    believed, where = trace.belief(50)
    unknown = whole((first == 0) | (first > 60)) & (truth != 100) & (near < 4.5)
    for cell in np.argwhere(unknown & whole(truth == 0))[::50]:
        row, col = where.cell(*frame.centre(*cell))
        # From grey to blue with the belief that the cell is free.
        if (
            0 < row < where.shape[0] - 1
            and believed[row - 1 : row + 2, col - 1 : col + 2].min() > 0.9
        ):
            red, _, blue = colour(cell)
            assert red < 180
            assert blue > 220
            return
    raise AssertionError("no cell that was believed free")


@pytest.mark.slow
def test_a_drive_of_an_older_run_is_replayed_without_last_resort_and_prediction(
    window, run, tmp_path
):
    later = ("last_resorts", "beliefs", "belief_corners", "gears")
    kept = {k: v for k, v in run.arrays.items() if k.rpartition("/")[2] not in later}
    write_report(replace(run, arrays=kept), tmp_path)
    opened(window, tmp_path, "#drive=0&arm=predicted&tick=30")
    assert shown(window, "clock") == ["3.0 s"]
    assert window.errors() == []


@pytest.mark.slow
def test_a_narrow_window_scrolls_in_one_direction_only(folder):
    if why := browser.missing():
        pytest.skip(why)
    narrow = browser.Browser(500, 900)
    try:
        opened(narrow, folder, "")
        assert narrow.run("return document.documentElement.scrollWidth <= innerWidth")
        sides = narrow.run(
            "return ['near', 'far'].map((id) => document.getElementById(id).offsetLeft)"
        )
        assert sides[0] == sides[1]
    finally:
        narrow.close()
