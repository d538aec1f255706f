"""Score predictors on what the car had not seen, over generated worlds and real maps.

python -m predictor.evaluate --help
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from predictor.grid import Grid
    from predictor.prediction import Prediction
    from predictor.scores import Scores

BLANK = "grey"
"""In the tables: an image that is grey all over, for comparing SSIM."""
TRUSTED = " (c·p)"
"""After a predictor's name: its probabilities times its confidence, as a planner takes them."""


class EvaluateError(ValueError):
    """An evaluation cannot be done; the message is one line."""


@dataclass(frozen=True)
class EvaluateConfig:
    """What is scored, on what.

    Attributes:
        world: families of generated worlds, map_server files, folders of them.
        predictors: by name, or `package.module:Class`.
        drives: in each family; in each map.
        seed: of the first.
        window: side of the square that the LIDAR writes into [m].
        expansion: predicted square over window.
        every: ticks between two predictions.
    """

    world: tuple[str, ...] = ("corridor", "narrow", "office", "trap")
    predictors: tuple[str, ...] = ("none", "extend", "compact")
    drives: int = 20
    seed: int = 0
    window: float = 5.0
    expansion: float = 2.0
    every: int = 10


def score_drive(
    config: EvaluateConfig, item: tuple[str, int]
) -> tuple[dict[str, Any], dict[str, NDArray]] | str:
    """Plain facts of one drive, and its scores by name; or a line why there was no drive.

    Args:
        config: what.
        item: a family or a map file, and a seed.
    """
    import numpy as np
    from skimage.metrics import structural_similarity

    from benchmarks.drive import task_in
    from planner.navigator import NavigatorConfig
    from predictor import checked, load_predictor
    from predictor.drives import driven, seen_again
    from predictor.grid import FREE, paste
    from predictor.samples import world_hash
    from predictor.scores import Scores, rings_of
    from sim import CarConfig, LidarConfig
    from sim.task import NoTaskError

    place, seed = item
    try:
        task = task_in(place, seed, CarConfig())
    except NoTaskError as error:
        return str(error)
    world, rng = task.world, np.random.default_rng(seed)
    frame, surface = world.grid.frame, world.surface
    predictors = {name: load_predictor(name) for name in config.predictors}
    scores = {name + end: Scores() for name in predictors for end in ("", TRUSTED)}
    similar: dict[str, list[float]] = {name: [] for name in (*predictors, BLANK)}
    taken: dict[str, list[float]] = {name: [] for name in predictors}
    side = NavigatorConfig(window=config.window, expansion=config.expansion).predicted_side
    states = driven(task, config.window, 0.0, rng)
    moments: list[tuple[float, NDArray[np.uint8]]] = []
    for known, state in seen_again(task, states, config.window, LidarConfig(), rng, config.every):
        square = known.frame.square(state[0], state[1], side)
        crop = known.crop(square)
        ring = rings_of(crop)
        free = paste(frame, world.grid.cells == FREE, square, np.bool_(False))
        occupied = paste(frame, surface, square, np.bool_(False))
        true_image = np.where(free, 1.0, np.where(occupied, 0.0, 0.5))
        blank = np.full(true_image.shape, 0.5)
        similar[BLANK].append(structural_similarity(blank, true_image, data_range=1.0))
        for name, predictor in predictors.items():
            begin = time.perf_counter()
            raw = predictor.predict(crop, state[:3])
            taken[name].append(1e3 * (time.perf_counter() - begin))
            belief = checked(raw, crop)
            image = image_of(crop, belief)
            similar[name].append(structural_similarity(image, true_image, data_range=1.0))
            trusted = belief.confidence * belief.p_free, belief.confidence * belief.p_occupied
            scores[name].add(belief.p_free, belief.p_occupied, free, occupied, ring)
            scores[name + TRUSTED].add(*trusted, free, occupied, ring)
            if name == config.predictors[-1] and (ring >= 0).any():
                off = float(((belief.p_free - free)[ring >= 0] ** 2).mean())
                moments.append((off, _picture(image_of(crop, None), image, true_image)))
    arrays = {
        f"{name}/{key}": value for name in scores for key, value in vars(scores[name]).items()
    }
    moments.sort(key=lambda entry: entry[0])
    shown = [moments[0], moments[len(moments) // 2], moments[-1]] if moments else []
    arrays |= {f"picture/{i}": picture for i, (_, picture) in enumerate(shown)}
    building = world_hash(world.grid.cells)
    facts = {
        "place": place, "seed": seed, "world": world.name, "hash": building,
        "learned_by": [name for name, p in predictors.items() if building in _learned(p)],
        "moments": len(similar[BLANK]), "ssim": {k: float(np.mean(v)) for k, v in similar.items()},
        "ms": {k: float(np.median(v)) for k, v in taken.items()},
        "errors": [off for off, _ in shown],
    }  # fmt: skip
    return facts, arrays


def _learned(predictor: Any) -> frozenset[str]:
    """Hashes of the buildings that a predictor says it was trained or tuned on."""
    facts = getattr(predictor, "facts", {})
    return frozenset(facts.get("worlds", ())) | frozenset(facts.get("validation_worlds", ()))


def image_of(known: Grid, prediction: Prediction | None) -> NDArray[np.float64]:
    """A map as a grey image, as in the paper: 1 free, 0 occupied, 0.5 unknown; between: expected.

    Args:
        known: what was seen.
        prediction: what is believed of the rest; None: nothing.
    """
    import numpy as np

    image = np.where(known.free, 1.0, np.where(known.occupied, 0.0, 0.5))
    if prediction is not None:
        believed = 0.5 + 0.5 * prediction.p_free - 0.5 * prediction.p_occupied
        image = np.where(known.unknown, believed, image)
    return np.asarray(image, dtype=np.float64)


def _picture(*images: NDArray[np.float64]) -> NDArray[np.uint8]:
    import numpy as np

    return np.rint(255 * np.stack(images)).astype(np.uint8)


def group_of(place: str) -> str:
    """What a family or a map file is reported under: its family, or its folder."""
    path = Path(place)
    return path.resolve().parent.name if path.suffix else place


class Evaluation:
    """A folder of scores that grows drive by drive.

    Args:
        config: what is scored.
        out: the folder.

    Raises:
        EvaluateError: if the folder holds an evaluation with other settings.
    """

    def __init__(self, config: EvaluateConfig, out: Path) -> None:
        from benchmarks.drive import sources

        self.config, self.out, self.parts = config, out, out / "parts"
        self.parts.mkdir(parents=True, exist_ok=True)
        marker, mine = out / "settings.json", json.loads(json.dumps(asdict(config)))
        if marker.exists() and json.loads(marker.read_text()) != mine:
            raise EvaluateError(f"--out {out} holds an evaluation with other settings; choose "
                                "another folder")  # fmt: skip
        marker.write_text(json.dumps(mine, indent=1))
        self.items = [
            (place, config.seed + n)
            for place in sources(config.world)
            for n in range(config.drives)
        ]

    def run(self, jobs: int) -> None:
        """Score what is missing, with a progress bar."""
        import io

        import numpy as np
        from tqdm import tqdm

        from benchmarks.store import write
        from benchmarks.workers import finished

        todo = [item for item in self.items if not self._part(item).exists()]
        with tqdm(total=len(self.items), initial=len(self.items) - len(todo), unit="drive") as bar:
            for item, scored in finished(partial(score_drive, self.config), todo, jobs):
                facts, arrays = ({"skipped": scored}, {}) if isinstance(scored, str) else scored
                buffer = io.BytesIO()
                text = np.frombuffer(json.dumps(facts).encode(), dtype=np.uint8)
                np.savez_compressed(buffer, allow_pickle=False, facts=text, **arrays)
                write(self._part(item), buffer.getvalue())
                bar.update()

    def finish(self) -> dict[str, Any]:
        """Write results.json and the figures of all that was scored, and return the results."""
        import numpy as np

        from benchmarks.store import commit, machine, write
        from predictor.evaluation_figures import draw
        from predictor.scores import EDGES, RINGS, Scores

        names = [n + end for n in self.config.predictors for end in ("", TRUSTED)]
        groups: dict[str, dict[str, Scores]] = {}
        facts: dict[str, list[dict[str, Any]]] = {}
        pictures: list[tuple[float, NDArray[np.uint8]]] = []
        for item in self.items:
            with np.load(self._part(item), allow_pickle=False) as part:
                fact = json.loads(bytes(part["facts"]))
                group = group_of(item[0])
                facts.setdefault(group, []).append(fact)
                if "skipped" in fact:
                    continue
                sums = groups.setdefault(group, {name: Scores() for name in names})
                for name in names:
                    sums[name] += Scores(**{k: part[f"{name}/{k}"] for k in vars(Scores())})
                pictures += [(e, part[f"picture/{i}"]) for i, e in enumerate(fact["errors"])]
        tables: dict[str, Any] = {}
        for group, sums in groups.items():
            scored = [fact for fact in facts[group] if "skipped" not in fact]
            tables[group] = {
                "drives": len(scored),
                "skipped": len(facts[group]) - len(scored),
                "moments": sum(fact["moments"] for fact in scored),
                "learned": sum(bool(fact["learned_by"]) for fact in scored),
                "predictors": {},
            }
            for name in [*names, BLANK]:
                row: dict[str, Any] = {}
                if name in scored[0]["ssim"]:
                    row["ssim"] = float(np.mean([f["ssim"][name] for f in scored]))
                if name in scored[0]["ms"]:
                    row["ms"] = float(np.median([f["ms"][name] for f in scored]))
                if name in sums:
                    row |= sums[name].measures()
                    row["rings"] = [
                        {"from": EDGES[i], **sums[name].measures(slice(i, i + 1))}
                        for i in range(RINGS)
                    ]
                tables[group]["predictors"][name] = row
        results = {
            "settings": asdict(self.config), "machine": machine(), "commit": commit(),
            "groups": tables, "drives": facts,
        }  # fmt: skip
        text = json.dumps(results, indent=1, default=str)
        write(self.out / "results.json", text.encode())
        draw(self.out, groups, pictures, self.config.predictors)
        return results

    def _part(self, item: tuple[str, int]) -> Path:
        name = item[0].strip("/").replace("/", "_")
        return self.parts / f"{name}-{item[1]}.npz"


def table(results: dict[str, Any]) -> str:
    """The scores as text: one block a group, one line a predictor."""
    columns = ("iou_free", "iou_occupied", "auc_free", "auc_occupied", "brier_free",
               "brier_occupied", "nll", "ece_free", "ece_occupied", "ssim", "ms")  # fmt: skip
    lines = []
    for group, entry in results["groups"].items():
        skipped = f", {entry['skipped']} without a drive" if entry["skipped"] else ""
        if entry["learned"]:
            skipped += f"; MIND: {entry['learned']} in buildings that a predictor has learned from"
        lines.append(f"\n{group}: {entry['drives']} drives, {entry['moments']} moments{skipped}")
        lines.append(f"{'':18}" + "".join(f"{c.replace('_', ' '):>16}" for c in columns))
        for name, row in entry["predictors"].items():
            cells = [f"{row[c]:16.3f}" if c in row else f"{'–':>16}" for c in columns]
            lines.append(f"{name:18}" + "".join(cells))
    return "\n".join(lines)


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 2 for bad arguments or input, 130 if interrupted."""
    default = EvaluateConfig()
    parser = argparse.ArgumentParser(
        prog="predictor.evaluate",
        description="Score predictors on the cells that the car had not seen, along drives of its "
        "own planner without prediction. The last predictor named gets a sheet of pictures. "
        "Interrupted, it goes on where it was: give the same command again.",
    )
    add = parser.add_argument
    add("--world", nargs="+", default=list(default.world), metavar="W",
        help="families of generated worlds, map_server .yaml files, folders of them (default: "
        "%(default)s)")  # fmt: skip
    add("--predictors", nargs="+", default=list(default.predictors), metavar="P",
        help="names, or module:Class (default: %(default)s)")  # fmt: skip
    add("--drives", type=int, default=default.drives, metavar="N",
        help="in each family, and in each map (default: %(default)s)")  # fmt: skip
    add("--seed", type=int, default=default.seed, metavar="N", help="default: %(default)s")
    add("--window", type=float, default=default.window, metavar="M",
        help="side of the square in which the LIDAR is used [m] (default: "
        "%(default)s)")  # fmt: skip
    add("--expansion", type=float, default=default.expansion, metavar="X",
        help="width of the predicted square over that of the window (default: "
        "%(default)s)")  # fmt: skip
    add("--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes")
    add("--out", type=Path, default=Path("results/evaluate"), metavar="DIR", help="scores and "
        "pictures (default: %(default)s)")  # fmt: skip
    args = parser.parse_args(argv)
    try:
        print(_run(args))
    except KeyboardInterrupt:
        print("interrupted; the same command goes on from here", file=sys.stderr)
        return 130
    except ValueError as error:
        print(f"predictor.evaluate: {error}", file=sys.stderr)
        return 2
    return 0


def _run(args: argparse.Namespace) -> str:
    from predictor import load_predictor

    if args.drives < 1 or args.jobs < 1 or not args.window > 0 or not 1 <= args.expansion <= 4:
        raise EvaluateError("--drives and --jobs are at least 1, --window is positive, and "
                            "--expansion lies between 1 and 4")  # fmt: skip
    for name in args.predictors:
        load_predictor(name)
    config = EvaluateConfig(tuple(args.world), tuple(args.predictors), args.drives, args.seed,
                            args.window, args.expansion)  # fmt: skip
    evaluation = Evaluation(config, args.out)
    evaluation.run(args.jobs)
    return table(evaluation.finish()) + f"\n\n{args.out / 'results.json'}"


if __name__ == "__main__":
    sys.exit(main())
