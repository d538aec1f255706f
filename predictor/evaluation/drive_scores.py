"""The scores of predictors along drives: their folder, the results, and the tables."""

from __future__ import annotations

import json
from dataclasses import asdict
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foresee.infra.command_line import UsageError
from foresee.infra.environment import commit, machine
from foresee.infra.markdown import markdown, span
from foresee.infra.part_file import Part
from foresee.infra.plain_json import without_nan
from foresee.infra.progress import progress
from foresee.infra.results_file import write_results
from foresee.infra.resumable import ResumableFolder
from foresee.infra.workers import finished
from foresee.mapping.family_names import FAMILIES
from foresee.statistics import MIN_GROUPS
from predictor.evaluation import scored_drive
from predictor.evaluation.figures import draw_evaluation
from predictor.evaluation.scored_drive import AS_ROOM, BLANK, VERSION, score_rows
from predictor.evaluation.settings import EvaluateConfig
from predictor.recording.settings import LEARNED
from predictor.registry import fingerprint_of
from predictor.scoring.scores import BINS, EDGES, RINGS, Scores, calibration_interval
from sim.buildings import map_hashes, sources


def report_groups(places: list[str]) -> dict[str, str]:
    """Return the group of each building: its family, or the shortest name of its map's folder.

    That is the end of the folder's path by which it differs from other folders and from families.

    Args:
        places: families of buildings, and paths of map files.
    """
    folders = {p: Path(p).resolve().parent.parts for p in places if p not in FAMILIES}
    names = {}
    for place in places:
        if place not in folders:
            names[place] = place
            continue
        parts, others = folders[place], {*folders.values()} - {folders[place]}
        for count in range(1, len(parts) + 1):
            names[place] = str(Path(*parts[-count:]))
            unique = all(parts[-count:] != other[-count:] for other in others)
            if unique and names[place] not in FAMILIES:
                break
    return names


class Group:
    """The scores of the drives in a group of buildings.

    Args:
        names: names of the rows of scores.

    Attributes:
        facts: facts of each drive.
        scores: row → scores of all drives.
        bins: row → building → `Scores.bins` of free.
    """

    def __init__(self, names: list[str]) -> None:
        self.facts: list[dict[str, Any]] = []
        self.scores = {name: Scores() for name in names}
        self.bins: dict[str, dict[str, NDArray[Any]]] = {name: {} for name in names}

    def add(self, facts: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Add a drive, which may have been skipped."""
        self.facts.append(facts)
        if "skipped" in facts:
            return
        for name, total in self.scores.items():
            scores = Scores.of(arrays, name)
            total += scores
            of_building = self.bins[name].setdefault(facts["hash"], np.zeros((BINS, 3)))
            of_building += scores.bins("free")


class DriveScores:
    """The scores of predictors along drives, in a folder with one part for each drive.

    Args:
        config: settings of the evaluation.
        out: folder of the scores.

    Raises:
        UsageError: if the folder holds scores with other settings, weights or maps, or a name is
            given twice.
    """

    def __init__(self, config: EvaluateConfig, out: Path) -> None:
        self.config, self.out = config, out
        maps = map_hashes(config.world)
        places = sources(config.world)
        if len(set(config.predictors)) < len(config.predictors):
            raise UsageError("--predictors: a name is given more than once")
        self.items = [(place, config.seed + n) for place in places for n in range(config.drives)]
        # The weights are compared, too, since a file of the same name may have changed.
        fingerprints = {name: fingerprint_of(name) for name in config.predictors}
        kept = asdict(config) | {"weights": fingerprints, "measures": VERSION}
        kept |= {"maps": maps} if maps else {}
        self.settings = json.loads(json.dumps(kept))
        self.folder = ResumableFolder(out, self.settings, unchecked=("maps",))

    def run(self, jobs: int) -> None:
        """Score the missing drives, with a progress bar."""

        todo = [item for item in self.items if self._read(item) is None]
        with progress(
            total=len(self.items), initial=len(self.items) - len(todo), unit="drive"
        ) as bar:
            for item, scored in finished(
                partial(scored_drive.score_drive, self.config), todo, jobs
            ):
                facts, arrays = ({"skipped": scored}, {}) if isinstance(scored, str) else scored
                facts |= {"place": item[0], "seed": item[1], "commit": commit()}
                self.folder.write(self._part(item), facts, arrays)
                bar.update()

    def finish(self) -> dict[str, Any]:
        """Write results.json and the figures of all scored drives, and return the results."""
        groups: dict[str, Group] = {}
        names = report_groups([place for place, _ in self.items])
        pictures: list[tuple[float, NDArray[Any]]] = []
        for item in self.items:
            part = self._read(item)
            if part is not None:
                facts, arrays = part
                group = groups.setdefault(names[item[0]], Group(score_rows(self.config)))
                group.add(facts, arrays)
                errors = enumerate(facts.get("errors", ()))
                pictures += [(error, arrays[f"picture/{i}"]) for i, error in errors]
        summaries = {name: _summary([group]) for name, group in groups.items()}
        learned = [name for name in groups if name in LEARNED]
        if len(learned) > 1:
            # Scores of all learned families together, since families may resemble each other.
            summaries[" + ".join(learned)] = _summary([groups[name] for name in learned])
        drives = {name: group.facts for name, group in groups.items()}
        results = {
            "settings": self.settings,
            "machine": machine(),
            "commits": sorted(
                {str(drive["commit"]) for every in drives.values() for drive in every}
            ),
            "groups": summaries,
            "drives": drives,
        }
        write_results(self.out / "results.json", "evaluation", without_nan(results))
        scores = {name: group.scores for name, group in groups.items()}
        draw_evaluation(self.out, scores, pictures, self.config.predictors)
        return results

    def _read(self, item: tuple[str, int]) -> Part | None:
        """Read the part of a drive; None if it is missing, damaged or of another drive."""
        part = self.folder.read(self._part(item))
        return part if part and [part[0]["place"], part[0]["seed"]] == [*item] else None

    def _part(self, item: tuple[str, int]) -> str:
        return f"parts/{self.items.index(item):05d}.npz"


def _summary(groups: list[Group]) -> dict[str, Any]:
    """Compute the scores of some groups together: predictor → measures."""
    names = list(groups[0].scores)
    facts = [drive for group in groups for drive in group.facts]
    scored = [drive for drive in facts if "skipped" not in drive]
    rows: dict[str, dict[str, Any]] = {}
    for name in [*names, BLANK] if scored else []:
        row = rows[name] = {}
        if name in scored[0]["ssim"]:
            row["ssim"] = float(np.mean([drive["ssim"][name] for drive in scored]))
        if name in scored[0]["ms"]:
            row["ms"] = float(np.median([drive["ms"][name] for drive in scored]))
        if name in names:
            scores = Scores()
            for group in groups:
                scores += group.scores[name]
            row |= _measures(name, scores, slice(None))
            bins = [list(group.bins[name].values()) for group in groups]
            row["ece_free_95"] = calibration_interval(bins)
            row["rings"] = [
                {"from": EDGES[i], **_measures(name, scores, slice(i, i + 1))} for i in range(RINGS)
            ]
    return {
        "drives": len(scored),
        "skipped": len(facts) - len(scored),
        "moments": sum(drive["moments"] for drive in scored),
        "learned": sum(bool(drive["learned_by"]) for drive in scored),
        "predictors": rows,
    }


def _measures(name: str, scores: Scores, rings: slice) -> dict[str, float]:
    """Compute the measures of a row; rows that end with `AS_ROOM` have none of occupied cells."""
    measures = scores.measures(rings)
    if name.endswith(AS_ROOM):
        return {k: v for k, v in measures.items() if not k.endswith("_occupied") and k != "nll"}
    return measures


def table(results: dict[str, Any]) -> str:
    """Return the tables of the scores of each group as Markdown: of all cells, and by distance."""
    columns = (
        "iou_free",
        "iou_occupied",
        "auc_free",
        "auc_occupied",
        "brier_free",
        "brier_occupied",
        "nll",
        "ece_free",
        "ece_occupied",
        "ssim",
        "ms",
    )
    parts = []
    for group, entry in results["groups"].items():
        skipped = f", {entry['skipped']} without a drive" if entry["skipped"] else ""
        if entry["learned"]:
            skipped += f"; warning: {entry['learned']} in buildings that a predictor was trained on"
        head = f"{group}: {entry['drives']} drives, {entry['moments']} moments{skipped}"
        rows = [["", *(column.replace("_", " ") for column in columns)]]
        for name, row in entry["predictors"].items():
            rows.append([name, *(_cell(row.get(column)) for column in columns)])
        if any(row.get("ece_free_95") for row in entry["predictors"].values()):
            rows[0].append("ece free, 95 %")
            for cells, row in zip(rows[1:], entry["predictors"].values(), strict=True):
                # Older results also have intervals over fewer buildings.
                enough = entry["drives"] >= MIN_GROUPS
                cells.append(span(row.get("ece_free_95") if enough else None, ".3f"))
        parts.append(f"{head}\n\n{markdown(rows)}")
        parts.append(_by_distance(entry["predictors"]))
    return "\n\n".join(parts)


def _by_distance(predictors: dict[str, Any]) -> str:
    """Return the table of the scores of free by the distance beyond the frontier."""
    rows: list[list[str]] = []
    for name, row in predictors.items():
        if "rings" in row and "(" not in name:
            edges = [ring["from"] for ring in row["rings"]]
            spans = [f"{low:g}–{high:g} m" for low, high in pairwise(edges)]
            rows = rows or [["iou / brier / ece free", *spans, f"{edges[-1]:g} m–"]]
            triples = [
                [ring[f"{measure}_free"] for measure in ("iou", "brier", "ece")]
                for ring in row["rings"]
            ]
            rows.append([name, *(" / ".join(map(_cell, values)) for values in triples)])
    return markdown(rows) if rows else ""


def _cell(value: float | None) -> str:
    return "" if value is None or value != value else f"{value:.3f}"
