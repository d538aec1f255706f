"""The command that makes the drives of a saved run again."""

from __future__ import annotations

import shlex
from dataclasses import fields
from typing import Any

import numpy as np

from benchmarks.runs.arms import CALIBRATED_ARM, arm_kind, arm_risk
from benchmarks.runs.saved_run import Run
from benchmarks.runs.settings import Settings
from foresee.mapping.car_file import CarFile, CarFileError

CHANGE_DEFAULTS = ("car", "start", "goal")
"""Settings that change the defaults of others; they have none themselves."""
NAMED_BY_ARMS = ("arms", "risk", "uncertified")
"""Settings that a run has in its arms and its drives."""


def command_of(run: Run) -> str:
    """Return the command line of `foresee corridor` that makes the drives of a run.

    A run does not name the files of `--calibration` and `--optimum`, so that they are not in it.
    """
    saved = {k: tuple(v) if isinstance(v, list) else v for k, v in run.settings.items()}
    given, of_car = {name: saved.get(name) for name in CHANGE_DEFAULTS}, set[str]()
    try:
        defaults = Settings.with_defaults(**given)
    except CarFileError:
        # The file is out of reach, and so are the defaults that it gives: the command names all.
        defaults = Settings.with_defaults(**given | {"car": None})
        of_car = {"vehicle", *(field.name for field in fields(CarFile))}
    arms = saved.get("arms", run.arms)
    words = ["foresee", "corridor", "--arms", ",".join(dict.fromkeys(map(arm_kind, arms)))]
    for field in fields(Settings):
        name, value = field.name, saved.get(field.name)
        default = None if name in CHANGE_DEFAULTS else getattr(defaults, name)
        is_option = "help" in field.metadata and name not in NAMED_BY_ARMS
        if is_option and value is not None and (value != default or name in of_car):
            words += [f"--{name.replace('_', '-')}", *_words(value)]
    risks = [arm_risk(arm) for arm in arms if arm_kind(arm) == CALIBRATED_ARM]
    if any(risks):
        words += ["--risk", *(f"{risk:g}" for risk in risks)]
    if any(episode.uncertified for episode in run.episodes):
        words.append("--uncertified")
    return shlex.join([*words, "--out", run.label])


def _words(value: Any) -> list[str]:
    """Return the words after an option; none after a flag."""
    if isinstance(value, bool):
        return []
    return [_word(each) for each in (value if isinstance(value, tuple) else (value,))]


def _word(value: Any) -> str:
    """Return a value as a word; numbers without an exponent.

    The parser takes a negative number with an exponent for an option.
    """
    text = str(value)
    exponent = isinstance(value, float) and "e" in text
    return np.format_float_positional(value, trim="-") if exponent else text
