"""Trials in which a command is interrupted at a random moment, and given again to continue."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import load_file

from foresee.infra.command_line import UsageError
from foresee.infra.environment import commit
from foresee.infra.markdown import records
from foresee.infra.progress import progress

KINDS = ("SIGKILL", "SIGTERM", "SIGINT", "disk full")
CASES = {
    "benchmarks.corridor": "--episodes 1 --arms known,full --seed 1000",
    "predictor.drives": "--train 2 --validation 1",
    "predictor.dataset": "--train 80 --test 40 --more 1 --validation 1 --length 40",
    "predictor.train": "--data {drives} --train 2 --validation 1 --steps 20 --batch 4",
    "predictor.evaluate": "--drives 1 --world corridor --predictors none extend",
    "predictor.study": "--data {frames} --archs unet_ff mlp --expansions 1.1 --preset short "
    "--width 0.0625 --side 64 --epochs 1",
}
"""Command → arguments that keep it short. {drives} and {frames} stand for data that are made by the
commands in `INPUTS` before."""
INPUTS = {"drives": "predictor.drives", "frames": "predictor.dataset"}
VOLATILE = {"machine", "commit", "commits", "seconds", "ms", "times"}
VOLATILE |= {"cycle_ms", "cycle_ms_p50", "cycle_ms_p99"}
"""Names of results that differ between any two runs: times, machine and commits."""
GONE = 15.0
"""Time within which all processes of an interrupted command must have ended [s]."""


def contents(folder: Path) -> dict[str, Any]:
    """Return name → JSON value, array or weights of the results in a folder, without `VOLATILE`."""
    results: dict[str, Any] = {}
    for path in sorted(folder.rglob("*")):
        name, inside = str(path.relative_to(folder)), path.relative_to(folder).parts
        if "parts" in inside:
            # Intermediate results are not compared; a command removes or ignores them at its end.
            continue
        if path.suffix in (".json", ".jsonl"):
            text = path.read_text(encoding="utf-8")
            values = text.splitlines() if path.suffix == ".jsonl" else [text]
            results[name] = [json.loads(value, object_hook=_lasting) for value in values]
        elif path.suffix in (".npz", ".safetensors"):
            arrays = load_file(path) if path.suffix == ".safetensors" else np.load(path)
            for key, value in arrays.items():
                if key.rpartition("/")[2] not in VOLATILE:
                    results[f"{name}:{key}"] = str(value.dtype), value.shape, value.tobytes()
        elif ".damaged" in path.name or path.suffix == ".tmp":
            results[name] = "left over"
    return results


def _lasting(results: dict[str, Any]) -> dict[str, Any]:
    """Return a JSON object without the names in `VOLATILE`."""
    return {k: v for k, v in results.items() if k not in VOLATILE}


def differences(first: dict[str, Any], second: dict[str, Any]) -> list[str]:
    """Return the names of results that differ between two folders, or are missing in one."""
    return sorted(k for k in first.keys() | second.keys() if first.get(k) != second.get(k))


def interrupted(
    work: Path, disk: Path | None, seconds: dict[str, float], trial: tuple[int, str, str, float]
) -> dict[str, Any]:
    """Interrupt a command once, run it again to its end, and compare its results.

    Args:
        work: folder of the input data and of the uninterrupted runs.
        disk: folder on a small file system of its own; needed for "disk full".
        seconds: time of an uninterrupted run of each command [s].
        trial: number of the trial, command, kind of interruption, and moment of the interruption as
            a share of the time of an uninterrupted run.

    Returns:
        The entry of the trial in the results.
    """
    index, command, kind, share = trial
    own = work / f"trial-{index}"
    shutil.rmtree(own, ignore_errors=True)
    own.mkdir()
    with _exclusive(disk) if kind == "disk full" and disk else nullcontext(own) as folder:
        words = _words(command, work, own, folder / "out")
        moment = share * seconds[command]
        process, in_time = _interrupted(words, own / "first.txt", kind, moment, folder)
        left = _left_behind(process.pid)
        said = (own / "first.txt").read_text(encoding="utf-8", errors="replace")
        with (own / "second.txt").open("w", encoding="utf-8") as file:
            again = subprocess.run(words, stdout=file, stderr=file).returncode
        differ = differences(contents(work / command), contents(folder / "out"))
    entry = {
        "index": index,
        "command": command,
        "kind": kind,
        "seconds": round(moment, 2),
        "interrupted": in_time,
        "status": process.returncode,
        "traceback": "Traceback" in said,
        "processes left": left,
        "status again": again,
        "differences": differ[:20],
    }
    if good(entry):
        shutil.rmtree(own)
    return entry


def _interrupted(
    words: list[str], output: Path, kind: str, moment: float, folder: Path
) -> tuple[subprocess.Popen[bytes], bool]:
    """Run a command to its end, and interrupt it at a moment [s].

    Returns:
        The process, and whether it was still running at that moment.
    """
    # The child must react to Ctrl-C, even if this command was started in the background.
    heed = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    with output.open("w", encoding="utf-8") as file:
        process = subprocess.Popen(
            words, stdout=file, stderr=file, start_new_session=True, preexec_fn=heed
        )
        try:
            process.wait(moment)
        except subprocess.TimeoutExpired:
            if kind == "disk full":
                with _full(folder):
                    process.wait()
            elif kind == "SIGINT":
                # A terminal sends Ctrl-C to the whole group.
                os.killpg(process.pid, signal.SIGINT)
            else:
                process.send_signal(getattr(signal, kind))
            process.wait()
            return process, True
    return process, False


def table(results: dict[str, Any]) -> str:
    """Return a Markdown table of the trials, one line for each command and kind of interruption."""
    rows = []
    for command, kind in itertools.product(CASES, KINDS):
        trials = [t for t in results["drives"] if (t["command"], t["kind"]) == (command, kind)]
        if trials:
            same = [t["status again"] == 0 and not t["differences"] for t in trials]
            rows.append(
                {
                    "command": f"`{command}`",
                    "interrupted by": kind,
                    "trials": len(trials),
                    "while it ran": sum(t["interrupted"] for t in trials),
                    "same results after": sum(same),
                    "tracebacks": sum(t["traceback"] for t in trials),
                    "processes left": sum(t["processes left"] for t in trials),
                }
            )
    return records(rows)


def good(trial: dict[str, Any]) -> bool:
    """Return whether a trial left no traceback, no process, and no difference in the results."""
    bad = ("traceback", "processes left", "status again", "differences")
    return not any(trial[name] for name in bad)


def references(work: Path, chosen: Iterable[str]) -> dict[str, float]:
    """Run each command without an interruption, and return command → time [s].

    Commands that make input data come first. Each command is run twice, and the second run is
    timed, since the first one may compile kernels. Runs of the same commit are not repeated.

    Args:
        work: folder of the input data and of the uninterrupted runs.
        chosen: commands.

    Raises:
        UsageError: if a command fails.
    """
    seconds = {}
    commands = dict.fromkeys([*INPUTS.values(), *chosen])
    for command in progress(commands, unit="command", desc="uninterrupted"):
        done = work / f"{command}.json"
        known = json.loads(done.read_bytes()) if done.exists() else {}
        if known.get("commit") != commit():
            own = work / f"data-{command}"
            for _ in range(2):
                for folder in (work / command, own):
                    shutil.rmtree(folder, ignore_errors=True)
                    folder.mkdir(parents=True)
                words = _words(command, work, own, work / command)
                began = time.monotonic()
                ran = subprocess.run(words, capture_output=True, encoding="utf-8", errors="replace")
                if ran.returncode:
                    lines = ran.stderr.strip().splitlines() or ["no message"]
                    raise UsageError(f"{command} failed without any interruption: {lines[-1]}")
            known = {"commit": commit(), "seconds": time.monotonic() - began}
            done.write_text(json.dumps(known), encoding="utf-8")
        seconds[command] = known["seconds"]
    return seconds


def _words(command: str, work: Path, own: Path, out: Path) -> list[str]:
    """Return the words of a command line; its input data are copied, since it may write there.

    Args:
        command: command.
        work: folder of the original input data.
        own: folder for the copies.
        out: folder of the results.
    """
    words = [sys.executable, "-m", command]
    for word in CASES[command].split():
        name = word.strip("{}")
        if word == f"{{{name}}}":
            shutil.copytree(work / INPUTS[name], own / name)
            word = str(own / name)
        words.append(word)
    return [*words, "--jobs", "2", "--out", str(out)]


@contextmanager
def _exclusive(disk: Path) -> Iterator[Path]:
    """Lock the small file system for one trial, and give it a folder that is removed at the end."""
    folder = disk / "trial"
    handle = os.open(disk, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        yield folder
        shutil.rmtree(folder)
    finally:
        os.close(handle)


@contextmanager
def _full(disk: Path) -> Iterator[None]:
    """Fill a file system until the end of this context."""
    filler = disk / "filler"
    with filler.open("wb", buffering=0) as file:
        for size in (1 << 20, 1 << 12, 1):
            try:
                while True:
                    file.write(bytes(size))
            except OSError as error:
                if error.errno != errno.ENOSPC:
                    raise
    try:
        yield
    finally:
        filler.unlink()


def _left_behind(session: int) -> int:
    """Wait for the end of all processes of a session; kill and count those that do not end."""
    end = time.monotonic() + GONE
    while (left := _members(session)) and time.monotonic() < end:
        time.sleep(0.2)
    for pid in left:
        # It may have ended by itself in the meantime.
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    return len(left)


def _members(session: int) -> list[int]:
    pids = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
        except OSError:
            # The process has just ended.
            continue
        if int(fields[3]) == session and fields[0] != "Z":
            pids.append(int(path.parent.name))
    return pids
