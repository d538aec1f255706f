"""Measurement of whether networks filter transient obstacles, as Katyal et al. 2018 report.

It uses the raw images of the networks, since for a planner observed cells keep their value. In
simulation, small obstacles are added to the input in observed free space, like traces of people who
walked past. Real logs contain transients already: cells that were observed occupied, but are free
in the map of all scans, away from any wall.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from benchmarks.studies.katyal2018.contestants import Contestant, Entrant, answers_in_grey, entrant
from benchmarks.studies.katyal2018.evaluation import Evaluation, ScoredDrive, expansion_key, hashed
from benchmarks.studies.katyal2018.square import ScoredSquare
from benchmarks.studies.katyal2018.stretch_scores import load_drive
from foresee.infra.progress import progress
from foresee.mapping.conventions import RESOLUTION
from foresee.mapping.grid import OCCUPIED, Grid

RADIUS, CLEAR = 0.15, 0.6
"""Radius of an added obstacle [m], and least distance of its middle from the car, from other added
obstacles, and from all cells that were not observed free [m]."""
PUT = 3
"""Number of obstacles that are added to an input, if there is room."""
OFF = 0.15
"""Least distance of a real transient from any cell that is truly not free [m]; a nearer one may be
a wall that was observed from a wrong pose."""
FRAMES = 60
"""Number of frames of each place, spread evenly over its drives."""


def counts(answer: Entrant, square: ScoredSquare, put_in: bool, seed: int) -> NDArray[np.int64]:
    """Count the cells of a square by what a network makes of them.

    Args:
        answer: function that asks the network about a square.
        square: the square.
        put_in: whether transients are added to the input; else those of the log are counted.
        seed: seed of the places of added transients.

    Returns:
        Numbers of cells, (5,): of transients; those that the network draws free, nearer to white
        than to grey; those that it draws free if the transients are not added (0 for real ones);
        of walls, which were observed occupied and are truly occupied; and those that the network
        draws occupied, since a network that erases everything also filters well. All are 0 if
        there are no transients.
    """
    given, transient = (
        with_transients(square, seed) if put_in else (square, transient_cells(square))
    )
    if not transient.any():
        return np.zeros(5, dtype=np.int64)
    image = answer(given).image
    before = (answer(square).image[transient] > 0.75).sum() if put_in else 0
    walls = square.crop.occupied & (square.truth == 1)
    filtered, kept = (image[transient] > 0.75).sum(), (image[walls] < 0.25).sum()
    return np.array([transient.sum(), filtered, before, walls.sum(), kept])


def shares(total: NDArray[np.int64], put_in: bool) -> dict[str, Any]:
    """Return the shares of cells for the results; NaN if there are no cells.

    Args:
        total: sum of `counts` over squares, (5,).
        put_in: whether the transients were added to the inputs.
    """
    cells, filtered, before, walls, kept = total.tolist()
    return {
        "cells": cells,
        "filtered": filtered / (cells or np.nan),
        "free_without": before / (cells or np.nan) if put_in else None,
        "wall_cells": walls,
        "walls_kept": kept / (walls or np.nan),
    }


def with_transients(square: ScoredSquare, seed: int) -> tuple[ScoredSquare, NDArray[np.bool_]]:
    """Add transients to the inputs of a square, and return it with their cells, (n, n).

    Args:
        square: square without transients.
        seed: seed of their places.
    """
    rng = np.random.default_rng(seed)
    n = len(square.truth)
    rows, cols = np.indices((n, n)) + 0.5 - n / 2
    clear = square.crop.free & square.window.free & (square.truth == 0)
    clear &= np.hypot(rows, cols) * RESOLUTION >= CLEAR
    put = np.zeros((n, n), dtype=bool)
    for _ in range(PUT):
        # Cells outside of the square count as not clear.
        room = distance_transform_edt(np.pad(clear & ~put, 1))[1:-1, 1:-1] * RESOLUTION
        places = np.argwhere(room >= CLEAR)
        if not len(places):
            break
        row, col = places[rng.integers(len(places))]
        row, col = row + 0.5 - n / 2, col + 0.5 - n / 2
        put |= np.hypot(rows - row, cols - col) * RESOLUTION <= RADIUS
    crop, window = (
        Grid(grid.frame, np.where(put, np.int8(OCCUPIED), grid.cells))
        for grid in (square.crop, square.window)
    )
    return replace(square, crop=crop, window=window), put


def transient_cells(square: ScoredSquare) -> NDArray[np.bool_]:
    """Return cells of the crop observed occupied that are truly free, and far from any wall."""
    off = np.asarray(distance_transform_edt(square.truth == 0)) * RESOLUTION
    return np.asarray(square.crop.occupied & (off > OFF))


def transients(evaluation: Evaluation) -> dict[str, Any]:
    """Measure the shares of all networks: place → expansion → network → shares."""
    out: dict[str, Any] = {place: {} for place in evaluation.places}
    chosen = {place: _spread_frames(evaluation, place) for place in out}
    # Ordered by expansion, since only the networks of one expansion fit into memory.
    asked = [
        (x, place, contestant)
        for x in evaluation.expansions
        for place in out
        for contestant in evaluation.who(x)
        if answers_in_grey(contestant)
    ]
    for expansion, place, contestant in progress(asked, desc="transients", unit="network"):
        frames = chosen[place]
        shots = [(drive.about["sha256"], index) for drive, index in frames]
        out[place].setdefault(expansion_key(expansion), {})[contestant.name] = (
            evaluation.store.once(
                f"{hashed('transients', shots, expansion, contestant.identity)}.json",
                partial(_shares, contestant, evaluation.rates[expansion], expansion, frames),
            )
        )
    return out


def _shares(
    contestant: Contestant,
    rates: tuple[float, float],
    expansion: float,
    frames: list[tuple[ScoredDrive, int]],
) -> dict[str, Any]:
    """Measure the shares of one network on some frames of a place."""
    answer, put_in = entrant(contestant, rates), frames[0][0].place == "simulated"
    total = np.zeros(5, dtype=np.int64)
    for seed, (drive, index) in enumerate(frames):
        square = ScoredSquare.of(load_drive(drive.folder, drive.number), index, expansion)
        total += counts(answer, square, put_in, seed)
    return shares(total, put_in)


def _spread_frames(evaluation: Evaluation, place: str) -> list[tuple[ScoredDrive, int]]:
    """Return frames of a place, spread evenly over its drives."""
    drives = [drive for drive in evaluation.drives if drive.place == place]
    frames = [(drive, index) for drive in drives for index in drive.chosen.tolist()]
    return [frames[i] for i in np.unique(np.linspace(0, len(frames) - 1, FRAMES).astype(int))]
