"""Splits of data into training, validation and test, which must share no building."""

from __future__ import annotations

from collections.abc import Mapping, Set
from itertools import combinations

from foresee.infra.errors import LineError


class SplitError(LineError):
    """Two splits share a building; the message is one line."""


def check_apart(worlds: Mapping[str, Set[str]]) -> None:
    """Check that no building is in two splits.

    Args:
        worlds: split → hashes of its buildings.

    Raises:
        SplitError: if one is.
    """
    for first, second in combinations(worlds, 2):
        shared = worlds[first] & worlds[second]
        if shared:
            raise SplitError(f"{len(shared)} buildings are both in {first} and in {second}")
