"""How long each stage of the control cycle takes, and how that grows.

python -m benchmarks.stages --help
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from sim.task import Task
    from sim.world import World

WARM_UP = 10
"""Ticks at the start of a drive that do not count: caches fill, the predictor is loaded."""
BEAMS = (180, 360, 720, 1081, 2160, 4320)
MAP_SIDES = (500, 1000, 2000, 4000, 8000)
WINDOW_AXIS = "window [m]\n(the predicted square is 13.7 m at most)"
WINDOWS = (5.0, 10.0, 20.0, 40.0)
EXPANSIONS = (1.0, 1.25, 1.5, 1.75, 2.0)
HORIZONS = (20, 30, 40, 60)
REPEATS = 200
"""Of everything that is measured apart from a drive."""
PEERS = ("octomap", "pyoctomap", "raycast2D", "irsim", "cv2")
"""Modules that `--peers` needs."""
HALLS, HALL_TICKS = 20, 60
"""Drives of each solver of the MPC's problem, and how long they are."""


def closed_loop(arm: str, drives: int, seed: int, v_max: float = 4.0) -> dict[str, list[float]]:
    """Times of each stage [ms], tick by tick, over drives through corridors.

    Args:
        arm: what the car may know, of `benchmarks.arms`.
        drives: how many count; one before them does not.
        seed: of the first.
        v_max: top speed [m/s].
    """
    from benchmarks.drive import drive
    from benchmarks.settings import Settings

    settings = Settings(arms=(arm,), seed=seed, v_max=v_max)
    times: dict[str, list[float]] = {}
    for index in range(-1, drives):
        _, trace = drive(settings, max(index, 0), arm)
        prefix = f"e{max(index, 0)}/{arm}/"
        if index < 0:
            continue
        for column, name in enumerate(trace[prefix + "time_names"].tolist()):
            taken = trace[prefix + "times"][WARM_UP:, column]
            # A path is not planned in every tick.
            times.setdefault(name, []).extend(taken[taken > 0.0].tolist())
    return times


def spread(times: list[float] | NDArray[np.float64]) -> dict[str, float]:
    """Median, tails and number of some times [ms]."""
    import numpy as np

    p50, p95, p99 = np.percentile(times, [50, 95, 99])
    return {"median_ms": float(p50), "p95_ms": float(p95), "p99_ms": float(p99),
            "samples": len(times)}  # fmt: skip


def timed(call: Callable[[int], Any], repeats: int) -> dict[str, float]:
    """The spread of the times of `call(0)`, `call(1)`, …, after one that does not count."""
    import time

    call(0)
    taken = []
    for i in range(repeats):
        started = time.perf_counter()
        call(i)
        taken.append(1e3 * (time.perf_counter() - started))
    return spread(taken)


def growth(seed: int, report: Callable[[str], None]) -> dict[str, list[dict[str, Any]]]:
    """How stages grow: axis → values, each with its stages.

    Args:
        seed: of the buildings.
        report: told what is being measured.
    """
    from benchmarks.drive import task_in
    from sim import CarConfig

    task = task_in("corridor", seed, CarConfig())
    measured: dict[str, list[dict[str, Any]]] = {
        "beams": [], "map side [cells]": [], WINDOW_AXIS: [], "expansion": [], "horizon N": [],
    }  # fmt: skip
    for beams in BEAMS:
        report(f"{beams} beams")
        measured["beams"].append({"value": beams, **_sensing(task, beams)})
    for side in MAP_SIDES:
        report(f"a map of {side} × {side} cells")
        measured["map side [cells]"].append({"value": side, **_casting(_cluttered(side, seed))})
    for window in WINDOWS:
        report(f"a window of {window:g} m")
        measured[WINDOW_AXIS].append({"value": window, **_believing(task, window, 2.0)})
    for expansion in EXPANSIONS:
        report(f"an expansion of {expansion:g}")
        measured["expansion"].append({"value": expansion, **_believing(task, 5.0, expansion)})
    for stages in HORIZONS:
        report(f"a horizon of {stages} stages")
        # The horizon is as long as a full stop takes, and half a second more.
        times = closed_loop("known", 1, seed, v_max=(stages - 5.5) * 0.1 * 1.5)
        measured["horizon N"].append({"value": stages, "mpc": spread(times["mpc"])})
    return measured


def _poses(task: Task, count: int) -> NDArray[np.float64]:
    """Poses along a task's way, (count, 3)."""
    import numpy as np

    way = task.waypoints
    at = np.linspace(1, len(way) - 2, count).astype(int)
    ahead = way[at + 1] - way[at]
    return np.column_stack([way[at], np.arctan2(ahead[:, 1], ahead[:, 0])])


def _sensing(task: Task, beams: int) -> dict[str, dict[str, float]]:
    from sim import Lidar, LidarConfig

    lidar, poses = Lidar(LidarConfig(beams=beams)), _poses(task, REPEATS)
    near, far = task.blank(5.0), task.blank(40.0)
    scans = [lidar.scan(task.world, pose) for pose in poses]
    return {
        "scan": timed(lambda i: lidar.scan(task.world, poses[i]), REPEATS),
        "integrate, window 5 m": timed(lambda i: near.integrate(scans[i], poses[i]), REPEATS),
        "integrate, window 40 m": timed(lambda i: far.integrate(scans[i], poses[i]), REPEATS),
    }


def _casting(world: World) -> dict[str, dict[str, float]]:
    import numpy as np

    from sim import Lidar

    lidar, rng = Lidar(), np.random.default_rng(0)
    free = 10 * np.argwhere(world.grid.free[::10, ::10])
    rows, cols = free[rng.integers(len(free), size=REPEATS)].T
    x, y = (0.05 * (index + 0.5) for index in (cols, rows))
    poses = np.column_stack([x, y, rng.uniform(-np.pi, np.pi, REPEATS)])
    return {"scan": timed(lambda i: lidar.scan(world, poses[i]), REPEATS)}


def _cluttered(side: int, seed: int) -> World:
    """A hall of a side [cells] of 0.05 m with boxes on its floor, one on 6 m²."""
    import numpy as np

    from predictor.grid import FREE, OCCUPIED, Grid, GridFrame
    from sim.world import World

    rng = np.random.default_rng(seed)
    cells = np.full((side, side), FREE, dtype=np.int8)
    for _ in range(round((0.05 * side) ** 2 / 6)):
        row, col = rng.integers(side, size=2)
        high, wide = rng.integers(3, 25, size=2)
        cells[row : row + high, col : col + wide] = OCCUPIED
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    return World(f"hall-{side}", Grid(GridFrame(0.05, (0.0, 0.0), (side, side)), cells))


def _believing(task: Task, window: float, expansion: float) -> dict[str, dict[str, float]]:
    import numpy as np

    from planner.navigator import NavigatorConfig
    from planner.risk import RiskMap
    from predictor import load_predictor
    from predictor.drives import seen_again
    from sim import LidarConfig

    config = NavigatorConfig(window=window, expansion=expansion, risk=0.05)
    poses = np.column_stack([_poses(task, REPEATS), np.zeros(REPEATS)])
    rng = np.random.default_rng(0)
    (*_, (known, _)) = seen_again(task, poses, window, LidarConfig(), rng, 1)
    squares = [known.frame.square(x, y, config.predicted_side) for x, y in poses[:, :2]]
    crops = [known.crop(square) for square in squares]
    predictor = load_predictor("compact")
    beliefs = [predictor.predict(crop, pose[:3]) for crop, pose in zip(crops, poses, strict=True)]
    near = [known.crop(known.frame.square(x, y, config.risk_side)) for x, y in poses[:, :2]]

    def risk(i: int) -> RiskMap:
        return RiskMap.from_prediction(near[i], beliefs[i], config.risk)

    return {
        "crop": timed(lambda i: known.crop(squares[i]), REPEATS),
        "predict": timed(lambda i: predictor.predict(crops[i], poses[i, :3]), REPEATS),
        "risk": timed(risk, REPEATS),
    }


def peers(seed: int, report: Callable[[str], None]) -> dict[str, dict[str, dict[str, float]]]:
    """The programs that a user would pick instead: stage → name → its time and ratio to ours.

    Args:
        seed: of the building.
        report: told what is being measured.
    """
    import numpy as np

    from benchmarks import peers as others
    from benchmarks import peers_mpc
    from benchmarks.drive import task_in
    from predictor.drives import seen_again
    from sim import CarConfig, LidarConfig

    task = task_in("corridor", seed, CarConfig())
    poses = _poses(task, REPEATS)
    states = np.column_stack([poses, np.zeros(REPEATS)])
    seen = seen_again(task, states, 5.0, LidarConfig(), np.random.default_rng(0), 1)
    crops = [known.crop(known.frame.square(s[0], s[1], 10.0)) for known, s in seen]
    found = {}
    for name, calls in {
        "rays": lambda: others.rays(task.world, poses),
        "mapping": lambda: others.mapping(task, poses),
        "distance transform": lambda: others.distances([crop.free for crop in crops]),
        "prediction": lambda: others.predictions(crops, poses),
    }.items():
        report(name)
        found[name] = others.compare(calls(), REPEATS)
    found["mpc"] = peers_mpc.compare(HALLS, HALL_TICKS, report)
    return found


def draw(measured: dict[str, list[dict[str, Any]]]) -> Figure:
    """A panel for each axis: medians as lines, up to the 99th percentile shaded."""
    from benchmarks.palette import new_figure

    figure = new_figure(13.0, 3.2)
    axes = figure.subplots(1, len(measured))
    for ax, (axis, entries) in zip(axes, measured.items(), strict=True):
        values = [entry["value"] for entry in entries]
        for name in entries[0]:
            if name == "value":
                continue
            median, tail = ([e[name][key] for e in entries] for key in ("median_ms", "p99_ms"))
            (line,) = ax.plot(values, median, marker="o", markersize=3, label=name)
            ax.fill_between(values, median, tail, color=line.get_color(), alpha=0.15, linewidth=0)
        ax.set_xlabel(axis)
        if values[-1] > 8 * values[0]:
            ax.set_xscale("log")
            ax.set_xticks(values, [str(value) for value in values], fontsize=7)
            ax.minorticks_off()
        ax.set_ylim(bottom=0)
        ax.legend(fontsize=7, frameon=False)
    axes[0].set_ylabel("time [ms], to the 99th percentile")
    return figure


def table(stages: dict[str, dict[str, dict[str, float]]]) -> str:
    """The stages of each arm, in Markdown."""
    lines = ["| arm | stage | median [ms] | p95 [ms] | p99 [ms] | samples |",
             "|---|---|---|---|---|---|"]  # fmt: skip
    for arm, of_arm in stages.items():
        for name, s in of_arm.items():
            numbers = " | ".join(f"{s[key]:.2f}" for key in ("median_ms", "p95_ms", "p99_ms"))
            lines.append(f"| `{arm}` | {name} | {numbers} | {s['samples']} |")
    return "\n".join(lines)


def peers_table(found: dict[str, dict[str, dict[str, float]]]) -> str:
    """The peers of each stage, in Markdown; nothing where there are none."""
    if not found:
        return ""
    lines = ["| stage | program | median [ms] | p99 [ms] | times ours | cost above ours | hits |",
             "|---|---|---|---|---|---|---|"]  # fmt: skip
    for stage, of_stage in found.items():
        for name, s in of_stage.items():
            cost = f"{s['dearer_percent']:+.3f} %" if "dearer_percent" in s else ""
            hits = f"{s['hits']:.0f}" if "hits" in s else ""
            lines.append(f"| {stage} | {name} | {s['median_ms']:.3f} | {s['p99_ms']:.3f} | "
                         f"{s['ratio']:.2f} | {cost} | {hits} |")  # fmt: skip
    return "\n".join(lines)


def tables(results: dict[str, Any]) -> str:
    """All of a results.json that is told in tables, in Markdown."""
    parts = [table(results["arms"]), f"Peak memory {results['peak_memory_mib']:.0f} MiB.",
             peers_table(results["peers"])]  # fmt: skip
    return "\n\n".join(part for part in parts if part)


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 2 for bad arguments."""
    from benchmarks.settings import OneLineParser, UsageError

    parser = OneLineParser(
        prog="benchmarks.stages",
        description="Time every stage of the control cycle over real drives, on one thread and "
        "after a warm-up, and how the stages grow with sensor, map, window and horizon. Leave the "
        "machine alone meanwhile.",
    )
    add = parser.add_argument
    add("--out", type=Path, default=Path("results/stages"), metavar="DIR",
        help="results.json and growth.png (default: %(default)s)")  # fmt: skip
    add("--drives", type=int, default=4, metavar="N", help="of each arm (default: %(default)s)")
    add("--seed", type=int, default=0, metavar="N", help="of the first (default: %(default)s)")
    add("--peers", action="store_true", help="beside the programs that one would pick instead: "
        "pip install 'foresee[peers]'; takes some minutes, most of them for compiling")  # fmt: skip
    args = parser.parse_args(argv)
    try:
        if args.drives < 1 or args.seed < 0:
            raise UsageError("--drives must be at least 1, and --seed at least 0")
        args.out.mkdir(parents=True, exist_ok=True)
        if args.peers:
            _ask_for(PEERS)
        print(_run(args))
    except KeyboardInterrupt:
        print("interrupted; nothing is kept", file=sys.stderr)
        return 130
    except (UsageError, OSError) as error:
        print(f"benchmarks.stages: {error}", file=sys.stderr)
        return 2
    return 0


def _ask_for(modules: tuple[str, ...]) -> None:
    """Find out before anything is measured that something is missing."""
    from importlib.util import find_spec

    from benchmarks.settings import UsageError

    missing = [name for name in modules if find_spec(name) is None]
    if missing:
        raise UsageError(f"--peers needs {', '.join(missing)}: pip install 'foresee[peers]'")


def _run(args: Any) -> str:
    import resource

    from tqdm import tqdm

    import benchmarks.workers  # noqa: F401  One thread, set before numpy is there.
    from benchmarks.arms import ARMS
    from benchmarks.store import commit, machine
    from predictor.whole import write_whole

    stages = {}
    arms = ("predicted", "known", "oracle")
    with tqdm(total=None, bar_format="{desc} [{elapsed}]") as bar:
        for arm in arms:
            bar.set_description_str(f"driving: {ARMS[arm].about}")
            times = closed_loop(arm, args.drives, args.seed)
            stages[arm] = {name: spread(taken) for name, taken in times.items() if taken}
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024

        def report(what: str) -> None:
            bar.set_description_str(f"measuring: {what}")

        grown = growth(args.seed, report)
        beside = peers(args.seed, report) if args.peers else {}
    results = {
        "machine": machine(), "commit": commit(), "threads": 1, "drives": args.drives,
        "seed": args.seed, "stages": stages["predicted"], "arms": stages,
        "peak_memory_mib": peak, "growth": grown, "peers": beside,
    }  # fmt: skip
    write_whole(args.out / "results.json", json.dumps(results, indent=1).encode())
    draw(grown).savefig(args.out / "growth.png")
    return f"{tables(results)}\n\n{args.out / 'results.json'}"


if __name__ == "__main__":
    sys.exit(main())
