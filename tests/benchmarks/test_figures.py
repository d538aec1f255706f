import json
import os
import subprocess
import sys
import warnings
from dataclasses import asdict, replace

import numpy as np
import pytest
from drive_results import a_result
from PIL import Image

from benchmarks import plot
from benchmarks.compare import plot as plot_run
from benchmarks.figures.animation import Animation, roll_out
from benchmarks.figures.file_name import file_name
from benchmarks.figures.moment import moment
from benchmarks.figures.palette import ARM_COLOURS, LIMIT_COLOURS, shrink
from benchmarks.figures.parting import leaves, parting
from benchmarks.figures.run_figures import draw_all
from benchmarks.figures.speed_profile import speed_profile
from benchmarks.figures.trajectories import trajectories
from benchmarks.runs.arms import ARMS
from benchmarks.runs.saved_run import Run
from benchmarks.runs.trace import RunError
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.control import Control
from planner.safety.limiting_factor import Limit
from sim.car import DubinsCar

TICKS = 12
FIGURES = ["moment.png", "speed_profile.png", "trajectories.png"]


def write_run(directory, arms=("known", "predicted"), outcomes=None, episodes=2):
    """A straight corridor, 12 m × 4 m, that each arm drives along with constant acceleration."""
    directory.mkdir(parents=True, exist_ok=True)
    cells = np.zeros((40, 120), np.int8)
    cells[:4], cells[-4:] = -1, -1
    cells[4], cells[-5] = 100, 100
    arrays, entries = {}, []
    for index in range(episodes):
        arrays[f"w{index}/cells"] = cells
        arrays[f"w{index}/frame"] = np.array([0.1, 0.0, 0.0])
        arrays[f"w{index}/waypoints"] = np.array([[6.0, 2.0], [10.0, 2.0]])
        for number, arm in enumerate(arms):
            for name, value in trace(cells, 1.0 + number, arm).items():
                arrays[f"e{index}/{arm}/{name}"] = value
            result = a_result(
                arm=arm,
                index=index,
                world="corridor-0",
                seed=index,
                goal=[10.0, 2.0],
                outcome=(outcomes or {}).get((index, arm), "reached"),
                time=TICKS * 0.1,
                path_length=1.0 + number,
                mean_speed=1.0 + number,
                sct=0.25 * (1 + number),
            )
            entries.append(asdict(result))
    np.savez_compressed(directory / "traces.npz", **arrays)
    results = {
        "settings": {"v_max": 4.0, "window": 5.0, "dt": 0.1},
        "summary": {arm: {} for arm in arms},
        "episodes": entries,
    }
    (directory / "results.json").write_text(json.dumps(results))
    return directory


def trace(cells, acceleration, arm):
    controls = np.tile([acceleration, 0.0], (TICKS, 1))
    states = roll_out(np.array([1.0, 2.0, 0.0, 0.0]), controls, 0.1)
    plans = np.tile([-1.0, 0.1], (TICKS, 6, 1)).astype(np.float16)
    first_seen = np.zeros(cells.shape, np.int16)
    first_seen[:, :40] = 1
    first_seen[:, 40:60] = TICKS // 2
    known = np.where(first_seen == 1, cells, np.int8(-1))
    out = {
        "states": states,
        "controls": controls.astype(np.float32),
        "plans": plans,
        "limits": np.arange(TICKS, dtype=np.uint8) % 2,
        "limit_names": np.array(["acceleration", "unseen space"]),
        "first_seen": first_seen,
        "relied_count": np.full(TICKS, 2, np.int32),
        "relied_cells": np.tile(np.array([[20, 41], [20, 42]], np.int16), (TICKS, 1)),
        "moment_tick": np.array(3),
        "moment_frame": np.array([0.1, 0.0, 0.0]),
        "moment_known": known,
        "moment_safe": known == 0,
        "moment_plan": roll_out(states[3], plans[3], 0.1).astype(np.float32),
        "moment_path": np.array([[1.0, 2.0], [10.0, 2.0]], np.float32),
    }
    if arm == "predicted":
        belief = np.full((40, 40), 128, np.uint8)
        out |= {
            "moment_prediction_frame": np.array([0.1, 2.0, 0.0]),
            "moment_p_free": belief,
            "moment_p_occupied": belief // 2,
            "moment_confidence": belief,
        }
    return out


def test_a_run_gives_three_figures_that_can_be_opened_and_nothing_else(tmp_path):
    run = write_run(tmp_path / "run", outcomes={(0, "predicted"): "collided"})
    before = {path.name for path in run.iterdir()}
    paths = draw_all(run)
    assert sorted(path.name for path in paths) == FIGURES
    assert {path.name for path in run.iterdir()} == before | set(FIGURES)
    for path in paths:
        with Image.open(path) as image:
            pixels = np.asarray(image.convert("L"))
        assert min(pixels.shape) > 400
        assert pixels.std() > 5


def backed_up(directory):
    """A run whose first drive goes forwards, then backwards."""
    write_run(directory, episodes=1)
    with np.load(directory / "traces.npz") as file:
        arrays = {name: file[name] for name in file.files}
    there = roll_out(
        np.array([2.0, 2.0, 0.0, 0.0]), np.array([[1.0, 0]] * 3 + [[-1.0, 0]] * 3), 0.1
    )
    there[-1, 3] = 0.0
    back = roll_out(there[-1], np.array([[1.0, 0.5]] * 6), 0.1, -1)
    states = np.vstack([there, back[1:]])
    plan = roll_out(states[-1], np.array([[1.0, 0.5]] * 3 + [[-1.0, 0.5]] * 9), 0.1)
    arrays |= {
        "e0/known/states": states,
        "e0/known/moment_plan": plan.astype(np.float32),
        "e0/known/gears": np.repeat([1, -1], 6).astype(np.int8),
    }
    np.savez_compressed(directory / "traces.npz", **arrays)
    return directory


def test_a_change_of_gear_is_found_where_the_car_turns_back(tmp_path):
    run = Run.load(backed_up(tmp_path / "run"))
    assert run.trace(0, "known").cusps.tolist() == [6]
    assert run.trace(0, "predicted").cusps.tolist() == []
    assert run.trace(0, "known").gears.tolist() == [1] * 6 + [-1] * 6
    assert run.trace(0, "predicted").gears.tolist() == [1] * TICKS  # An older trace.


def test_driving_backwards_is_shown_in_every_figure(tmp_path):
    run = Run.load(backed_up(tmp_path / "run"))
    assert len(draw_all(tmp_path / "run")) == 3
    profile = speed_profile([run]).axes[0]
    assert profile.get_ylim()[0] < -0.5
    assert "in reverse" in [text.get_text() for text in profile.texts]
    legend = trajectories(run).legends[0]
    assert "change of gear" in [text.get_text() for text in legend.get_texts()]
    labels = [ax.get_xlabel() for ax in moment(run, 0, "known").axes]
    assert "distance driven in reverse [m]" in labels
    for index, arm in ((0, "known"), (0, "predicted")):
        Animation(run, index, arm).frame(TICKS - 1)


def test_drives_without_a_reverse_gear_look_as_before(tmp_path):
    run = Run.load(write_run(tmp_path / "run"))
    assert speed_profile([run]).axes[0].get_ylim()[0] == 0
    legend = trajectories(run).legends[0]
    assert "change of gear" not in [text.get_text() for text in legend.get_texts()]


def test_figures_lead_with_time_and_sct(tmp_path):
    run = Run.load(write_run(tmp_path / "run"))
    texts = [text.get_text() for ax in trajectories(run).axes for text in ax.texts]
    assert {"reached · 1.2 s · SCT 0.25", "reached · 1.2 s · SCT 0.50"} <= set(texts)
    profile = speed_profile([run])
    texts = [text.get_text().strip() for ax in profile.axes for text in ax.texts]
    assert {"1.2 s · SCT 0.25", "1.2 s · SCT 0.50"} <= set(texts)
    assert not any("m/s" in text for text in texts)
    assert "SCT,\nall 2 episodes" in [ax.get_title() for ax in profile.axes]


def test_a_run_without_sct_is_drawn_with_what_it_has(tmp_path):
    run = write_run(tmp_path / "run")
    results = json.loads((run / "results.json").read_text())
    for number, episode in enumerate(results["episodes"]):
        if number:
            del episode["sct"]
        else:
            episode["sct"] = None
    (run / "results.json").write_text(json.dumps(results))
    assert len(draw_all(run)) == 3
    profile = speed_profile([Run.load(run)])
    assert "1.2 s" in [text.get_text().strip() for ax in profile.axes for text in ax.texts]


ODD = "a$b_{c}$ \\\\frac^ _x 建物 😀 $"
"""A name that is mathematics to matplotlib, and has characters that its fonts lack."""
ENVIRONMENT = """\
import sys, warnings
from pathlib import Path

warnings.simplefilter("error")
from benchmarks.figures.run_figures import draw_all
import matplotlib

before = dict(matplotlib.rcParams)
draw_all(Path(sys.argv[1]))
assert dict(matplotlib.rcParams) == before
"""


def named(directory, name):
    """A run whose buildings have a name."""
    write_run(directory)
    results = json.loads((directory / "results.json").read_text())
    for episode in results["episodes"]:
        episode["world"] = name
    (directory / "results.json").write_text(json.dumps(results))
    return directory


@pytest.mark.parametrize("name", [ODD, "two\nlines\x1b[31m" + 100 * " long"])
def test_names_of_buildings_are_shown_as_they_are(tmp_path, name):
    run = named(tmp_path / "run", name)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(draw_all(run)) == 3
        Animation(Run.load(run)).frame(0)
        figure = plot_run(Run.load(run))
        figure.savefig(tmp_path / "figure.png")
    title = figure.axes[0].get_title(loc="left")
    assert title.startswith(f"Episode 0 · {' '.join(name.split())[:9]}")
    assert len(title) < 90


def test_figures_do_not_depend_on_the_users_matplotlib(tmp_path):
    # What a process inherits from a notebook in another environment.
    backend = "module://matplotlib_inline.backend_inline"
    run, plain = write_run(tmp_path / "run"), write_run(tmp_path / "plain")
    style = "text.usetex: True\nfont.size: 20\naxes.facecolor: black\nsavefig.bbox: tight\n"
    (tmp_path / "matplotlibrc").write_text(style + "axes.formatter.use_mathtext: True\n")
    done = subprocess.run(
        [sys.executable, "-c", ENVIRONMENT, str(run)],
        env=os.environ | {"MPLBACKEND": backend, "MATPLOTLIBRC": str(tmp_path / "matplotlibrc")},
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr) == (0, "")
    for path in draw_all(plain):
        assert path.read_bytes() == (run / path.name).read_bytes()


def test_a_notebook_displays_a_figure_without_pyplot(tmp_path):
    figure = plot_run(Run.load(write_run(tmp_path / "run")))
    assert figure._repr_png_().startswith(b"\x89PNG")


def test_figures_are_written_all_or_none(tmp_path):
    run = write_run(tmp_path / "run")
    with np.load(run / "traces.npz") as file:
        arrays = {name: file[name] for name in file.files if "moment_plan" not in name}
    np.savez_compressed(run / "traces.npz", **arrays)
    before = sorted(run.iterdir())
    with pytest.raises(RunError, match="moment_plan"):
        draw_all(run)
    assert sorted(run.iterdir()) == before


def test_an_arm_without_a_prediction_has_a_moment_too(tmp_path):
    assert len(draw_all(write_run(tmp_path / "run", arms=("known",), episodes=1))) == 3


def test_the_episode_shown_is_the_first_that_all_arms_reached(tmp_path):
    assert Run.load(write_run(tmp_path / "a")).showcase == 0
    crash = {(0, "known"): "stuck"}
    assert Run.load(write_run(tmp_path / "b", outcomes=crash)).showcase == 1
    crash |= {(1, "predicted"): "collided"}
    assert Run.load(write_run(tmp_path / "c", outcomes=crash)).showcase == 0


def test_two_runs_share_one_speed_profile(tmp_path, capsys):
    first, second = write_run(tmp_path / "a"), write_run(tmp_path / "b", arms=("known", "oracle"))
    out = tmp_path / "out"
    assert plot.main([str(first), str(second), "--out", str(out), "--episode", "1"]) == 0
    printed = capsys.readouterr().out.split()
    assert str(out / "speed_profiles-1.png") in printed
    names = [name.replace(".", "-1.") for name in FIGURES]
    assert all((out / run / name).is_file() for run in "ab" for name in names)
    assert len(printed) == 7


def test_runs_without_the_episode_have_no_line_in_the_shared_speed_profile(tmp_path):
    runs = [Run.load(write_run(tmp_path / name, episodes=n)) for name, n in (("a", 2), ("b", 1))]
    figure = speed_profile(runs, 1)
    labels = [line.get_label() for line in figure.axes[0].get_lines()]
    assert any(str(label).startswith("a: ") for label in labels)
    assert not any(str(label).startswith("b: ") for label in labels)
    with pytest.raises(RunError, match="no episode 7"):
        speed_profile(runs, 7)


def test_figures_of_a_chosen_episode_and_arm_replace_no_others(tmp_path):
    run = write_run(tmp_path / "run", arms=("known", "predicted 2 %"))
    draw_all(run)
    before = {path.name: path.read_bytes() for path in run.iterdir()}
    assert plot.main([str(run), "--episode", "1", "--arm", "predicted 2 %"]) == 0
    after = {path.name: path.read_bytes() for path in run.iterdir()}
    assert before.items() <= after.items()
    added = {"speed_profile-1.png", "trajectories-1.png", "moment-1-predicted-2.png"}
    assert set(after) - set(before) == added


@pytest.mark.parametrize(
    ("episode", "arm", "name"),
    [
        (None, None, "moment.gif"),
        (3, None, "moment-3.gif"),
        (None, "known+route", "moment-known+route.gif"),
        (3, "predicted 0.5 %", "moment-3-predicted-0.5.gif"),
    ],
)
def test_the_name_of_a_figure_tells_what_was_chosen(episode, arm, name):
    assert file_name("moment", "gif", episode, arm) == name


@pytest.mark.parametrize("row", [4, -1, 40], ids=["a wall", "above the map", "below the map"])
def test_the_moment_that_is_shown_relies_on_cells_that_are_free(tmp_path, row):
    run = Run.load(write_run(tmp_path / "run"))
    wrong = run.trace(1, "predicted").read("relied_cells").copy()
    wrong[:, 0] = row
    right = dict(run.arrays)
    for spoilt, shown in ((0, 1), (1, 0)):
        arrays = right | {f"e{spoilt}/predicted/relied_cells": wrong}
        title = moment(replace(run, arrays=arrays)).get_suptitle()
        assert title.startswith(f"predicted · episode {shown}")


def test_a_way_is_left_where_it_leads_away_from_the_other_for_good():
    along = np.arange(0.0, 6.0, 0.4)
    straight = np.column_stack([along, np.zeros_like(along)])
    # It weaves by less than a metre, and turns away after 3 m.
    aside = np.where(along > 3.0, along - 3.0, 0.2 * np.sin(9 * along))
    turning = np.column_stack([along, aside])
    assert along[leaves(turning, straight)] == pytest.approx(3.2)
    assert leaves(straight[::2], straight) is None
    # A way that stops early is not left by a shorter one, but by one that goes on.
    assert leaves(straight[:5], straight) is None
    assert leaves(straight, straight[:5]) == 4


def test_two_drivers_are_drawn_where_their_ways_part(tmp_path):
    run = write_run(tmp_path / "run")
    with pytest.raises(RunError, match="known and predicted part in no such episode"):
        parting(Run.load(run))
    arrays = dict(np.load(run / "traces.npz"))
    # The second drive of `predicted` turns off after 0.3 m, between 0.5 and 0.6 s.
    states = arrays["e1/predicted/states"]
    far = states[:, 0] - 1.3
    states[:, :2] += np.where(far > 0, far, 0.0)[:, None] * [-1.0, 1.0]
    np.savez_compressed(run / "traces.npz", **arrays)
    for ax in parting(Run.load(run)).axes:
        (clock,) = (text.get_text() for text in ax.texts if text.get_text().endswith(" s"))
        assert 0.2 < float(clock.removesuffix(" s")) < 0.8
        assert "--" in {line.get_linestyle() for line in ax.lines}
    assert plot.main([str(run), "--parting", "--episode", "1", "--out", str(tmp_path)]) == 0
    assert (tmp_path / "parting-1.png").exists()


def test_runs_of_the_same_name_are_not_written_over_each_other(tmp_path, capsys):
    runs = [str(write_run(tmp_path / name / "run")) for name in "ab"]
    assert plot.main([*runs, "--out", str(tmp_path / "out")]) == 2
    assert "overwrite each other" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_figures_of_one_arm_show_one_that_uses_a_prediction(tmp_path):
    arms = ("known", "known+route", "optimistic")
    assert Run.load(write_run(tmp_path / "a", arms=arms)).pick_arm(0) == "known+route"
    assert Run.load(write_run(tmp_path / "b", arms=("known", "oracle"))).pick_arm(0) == "oracle"
    assert Run.load(write_run(tmp_path / "c", arms=("known",))).pick_arm(0) == "known"
    arms = ("known", "backup", "predicted 2 %")
    assert Run.load(write_run(tmp_path / "d", arms=arms)).pick_arm(0) == "predicted 2 %"


@pytest.mark.parametrize(("stride", "frames"), [(1, 12), (5, 4)])
def test_a_gif_has_a_frame_for_every_stride_of_ticks_and_one_for_the_last(tmp_path, stride, frames):
    run = write_run(tmp_path / "run", episodes=1)
    command = [str(run), "--animate", "--format", "gif", "--stride", str(stride)]
    assert plot.main(command) == 0
    with Image.open(run / "drive-0-predicted.gif") as image:
        assert getattr(image, "n_frames", 1) == frames
        assert image.info["duration"] == 100 * stride


def test_the_last_frame_shows_a_collision(tmp_path):
    safe = Animation(Run.load(write_run(tmp_path / "a")), 0, "known")
    crash = {(0, "known"): "collided"}
    unsafe = Animation(Run.load(write_run(tmp_path / "b", outcomes=crash)), 0, "known")
    near = (slice(50, 420), slice(20, 400))
    assert (safe.frame(5)[near] == unsafe.frame(5)[near]).all()
    assert (safe.frame(TICKS - 1)[near] != unsafe.frame(TICKS - 1)[near]).any()


def test_the_map_of_an_animation_grows_as_cells_are_seen(tmp_path):
    show = Animation(Run.load(write_run(tmp_path / "run")))
    known = [int((show.seen(tick).cells != -1).sum()) for tick in range(TICKS)]
    assert known[0] < known[-1]
    assert known == sorted(known)


@pytest.mark.parametrize(
    "spoil",
    [
        "empty",
        "missing",
        "file",
        "broken",
        "list",
        "no traces",
        "bad traces",
        "no episodes",
        "bad episode",
    ],
)
def test_bad_input_ends_with_status_2_and_one_line(tmp_path, capsys, spoil):
    run = tmp_path / "run"
    if spoil == "empty":
        run.mkdir()
    elif spoil == "file":
        run.write_text("")
    elif spoil != "missing":
        write_run(run)
        results = json.loads((run / "results.json").read_text())
        text = json.dumps(results)
        if spoil == "broken":
            text = text[:50]
        elif spoil == "list":
            text = "[]"
        elif spoil == "no episodes":
            text = json.dumps(results | {"episodes": []})
        elif spoil == "bad episode":
            text = json.dumps(results | {"episodes": [{"arm": "known"}]})
        elif spoil == "no traces":
            (run / "traces.npz").unlink()
        elif spoil == "bad traces":
            (run / "traces.npz").write_bytes(b"PK\x03\x04 not a zip")
        (run / "results.json").write_text(text)
    assert plot.main([str(run)]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert len(captured.err.strip().splitlines()) == 1
    assert str(run) in captured.err


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("e0/predicted/states", np.zeros((TICKS + 1, 3))),
        ("e0/predicted/states", np.full((TICKS + 1, 4), np.nan)),
        ("e0/predicted/states", np.zeros((0, 4))),
        ("e0/predicted/plans", np.zeros((TICKS, 6))),
        ("e0/predicted/limits", np.full(TICKS, 200, np.uint8)),
        ("e0/predicted/relied_count", np.full(TICKS, 3, np.int32)),
        ("e0/predicted/first_seen", np.zeros((3, 3), np.int16)),
        ("e0/predicted/moment_frame", np.array([0.0, 0.0, 0.0])),
        ("e0/predicted/moment_frame", np.zeros(2)),
        ("e0/predicted/moment_safe", np.zeros((3, 3), bool)),
        ("e0/predicted/moment_plan", np.full((7, 4), np.inf)),
        ("e0/predicted/moment_path", np.zeros(4)),
        ("e0/predicted/moment_confidence", np.zeros((2, 2), np.uint8)),
        ("w0/cells", np.zeros(7, np.int8)),
        ("w0/frame", np.array([np.nan, 0.0, 0.0])),
    ],
)
def test_arrays_of_the_wrong_kind_are_named(tmp_path, capsys, name, value):
    run = write_run(tmp_path / "run", episodes=1)
    with np.load(run / "traces.npz") as file:
        arrays = {key: file[key] for key in file.files}
    assert name in arrays
    np.savez_compressed(run / "traces.npz", **(arrays | {name: value}))
    assert plot.main([str(run), "--animate", "--format", "gif"]) == 2
    said = capsys.readouterr().err.strip()
    assert len(said.splitlines()) == 1
    assert "broken" in said
    assert name in said or "frame" in name


@pytest.mark.parametrize(
    "extra",
    [["--episode", "7"], ["--arm", "oracle"], ["--episode", "x"], ["--stride", "0"], ["--colour"]],
)
def test_bad_arguments_end_with_status_2_and_one_line(tmp_path, capsys, extra):
    run = write_run(tmp_path / "run")
    try:
        status = plot.main([str(run), *extra])
    except SystemExit as error:
        status = error.code
    assert status == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
    assert not list(run.glob("*.png"))


def test_a_plan_rolls_out_as_the_car_drives():
    car, dt = DubinsCar(CarLimits(reverse=4.0)), 0.1
    controls = np.random.default_rng(0).uniform([-1.0, -0.3], [0.5, 0.3], (20, 2))
    for speed, gear in ((2.5, 1), (2.5, -1), (-2.5, 1), (0.0, -1)):
        state = np.array([1.0, -2.0, 3.0, speed])
        # Neither stops within a step.
        driven = controls if speed else np.abs(controls)
        states = roll_out(state, driven, dt, gear)
        for control, expected in zip(driven, states[1:], strict=True):
            state = car.step(state, Control(*control, gear), dt)
            np.testing.assert_allclose(state, expected, atol=1e-9)


def test_every_arm_and_every_limit_has_a_colour_of_its_own():
    assert set(ARM_COLOURS) == set(ARMS)
    assert set(LIMIT_COLOURS) == {str(limit) for limit in Limit}
    assert len(set(ARM_COLOURS.values())) == len(ARMS)
    assert len(set(LIMIT_COLOURS.values())) == len(Limit)


def test_thin_walls_outlive_shrinking():
    cells = np.zeros((30, 31), np.int8)
    cells[:, 13] = 100
    small = shrink(cells, 4)
    assert small.shape == (8, 8)
    assert (small[:, 3] == 100).all()
    assert (small == 100).sum() == 8
