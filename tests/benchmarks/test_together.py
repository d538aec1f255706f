"""Pools of calibrations, and certificates that hold for all families together."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks import tables
from benchmarks.calibration.together import joint, pooled, together
from planner.risk.betting import capital, needed

RESULTS = Path(__file__).parents[2] / "docs/results"
EARLIER = RESULTS / "calibration-revision-1"
FIRST, SECOND = RESULTS / "calibration-fixed-first.json", EARLIER / "fixed-mixture.json"
FAMILIES = ("corridor", "floor_plan", "narrow", "office", "paper")


def made(world="corridor", seed=0, **levels):
    """A calibration for a risk of 0.05 with (drives, collided) at levels such as L01, 0.01."""
    tests = []
    for name, (drives, collided) in levels.items():
        most = capital(np.arange(drives) < collided, 0.05).max()
        tests.append(
            {
                "level": float(f"0.{name[1:]}"),
                "drives": drives,
                "collided": collided,
                "capital": {"0.05": float(most)},
                "km": drives / 20,
                "speed": 2.0,
                "nominal_interval": None,
            }
        )
    conditions = {"world": [world], "predictor": "none"}
    return {"conditions": conditions, "confidence": 0.9, "seed": seed, "levels": tests}


def test_a_pool_is_the_test_of_all_drives_one_after_the_other():
    parts = made(L01=(60, 0), L03=(90, 2)), made(L01=(60, 0), L1=(10, 5))
    pool = pooled(parts)
    # Neither sixty drives nor ninety with two collisions certify 0.05; all of them at 0.01 do.
    assert all(part["levels"][0]["capital"]["0.05"] < needed(0.9) for part in parts)
    assert pool["certified"] == {"0.05": 0.01}
    counts = [(test["level"], test["drives"], test["collided"]) for test in pool["levels"]]
    assert counts == [(0.01, 120, 0), (0.03, 90, 2), (0.1, 10, 5)]
    everything = capital(np.zeros(120), 0.05)[-1]
    assert pool["levels"][0]["capital"]["0.05"] == pytest.approx(everything)
    assert pool["levels"][0]["km"] == pytest.approx(6.0)
    assert pool["levels"][0]["speed"] == pytest.approx(2.0)


def test_a_pool_keeps_what_speaks_against_a_level():
    good, bad = made(L01=(75, 0)), made(L01=(75, 9))
    assert pooled([good])["levels"][0]["capital"]["0.05"] >= needed(0.9)
    assert pooled([good, bad])["certified"] == {}


def test_a_pool_does_not_depend_on_the_order_of_its_calibrations():
    parts = [made(L01=(100, 1)), made(L01=(80, 2)), made(L01=(90, 0))]
    capitals = [
        pooled(order)["levels"][0]["capital"]["0.05"]
        for order in (parts, parts[::-1], parts[1:] + parts[:1])
    ]
    assert capitals == pytest.approx([capitals[0]] * 3)


def test_a_joint_certificate_needs_more_evidence_in_each_family():
    # 70 drives without a collision certify 0.05 alone, and 109 with four others.
    few = {f"family {i}": made(f"{i}", L01=(100, 0)) for i in range(5)}
    for row in joint(few):
        assert [*row.values()][1:] == ["0.01", "–"]
    for row in joint({name: made(name, L01=(110, 0)) for name in few}):
        assert [*row.values()][1:] == ["0.01", "0.01"]
    # Alone, a family needs no more than its own certificate.
    (row,) = joint({"corridor": made(L01=(75, 0))})
    assert [*row.values()][1:] == ["0.01", "0.01"]


def test_joint_certificates_are_seldom_wrong_where_all_families_are_as_dangerous_as_can_be():
    rng = np.random.default_rng(0)
    alone, jointly = 0, 0
    for _ in range(400):
        # The chance of a collision is the one that is tested: no certificate is right.
        tests = [capital(rng.random(200) < 0.05, 0.05).max() for _ in FAMILIES]
        alone += max(tests) >= needed(0.9)
        jointly += max(tests) >= needed(1 - 0.1 / 5)
    assert alone > 0.15 * 400
    assert jointly < 0.1 * 400


def test_published_calibrations_of_the_mixture_and_their_pool_certify_what_the_page_says(capsys):
    first, second = (json.loads(path.read_text()) for path in (FIRST, SECOND))
    assert (first["seed"], second["seed"]) == (5_000_000, 5_200_000)
    assert first["certified"] == {"0.02": 0.01, "0.05": 0.03}
    assert pooled([first, second])["certified"] == second["certified"]
    families = [EARLIER / f"fixed-{family}.json" for family in FAMILIES]
    assert tables.main([*map(str, families), str(FIRST), str(SECOND)]) == 0
    shown = capsys.readouterr().out
    assert "Pool of calibration-fixed-first, fixed-mixture:" in shown
    assert "| 0.03  | 517    | 3        |" in shown
    assert "All 5 together" in shown
    # 0.05 is certified in all families together at the same levels; 0.02 is in none.
    assert re.search(r"\| `office` +\| 0.1 +\| – +\| 0.3 ", shown)


def test_calibrations_of_other_conditions_are_kept_apart():
    one, other = made(L01=(75, 0)), made(L01=(75, 0))
    other["conditions"] |= {"predictor": "extend"}
    assert together({"a": one, "b": other}) == ""
    assert together({"a": one}) == ""
    other["conditions"] |= {"predictor": "none", "world": ["narrow"]}
    assert "All 2 together" in together({"a": one, "b": other})


def test_calibrations_of_another_revision_are_kept_apart():
    first = made(seed=0, L01=(75, 0))
    second = made(seed=1000, L01=(75, 0)) | {"revision": 2}
    assert together({"a": first, "b": second}) == ""
    # Older calibrations do not name the first revision.
    assert "Pool of a, b:" in together({"a": first, "b": second | {"revision": 1}})
    elsewhere = made("narrow", L01=(75, 0))
    assert together({"a": elsewhere, "b": second}) == ""


def test_calibrations_whose_drives_may_be_the_same_are_not_pooled():
    first, apart = made(seed=0, L01=(75, 0), L03=(20, 0)), made(seed=75, L01=(75, 0))
    assert "Pool of a, b:" in together({"a": first, "b": apart})
    said = together({"a": first, "b": made(seed=74, L01=(75, 0)), "c": made("narrow", L01=(75, 0))})
    assert said.startswith(
        "No pool of a, b: drives of a and of b may have the same seeds, from 74;"
    )
    # Of the seeds up to the most drives, some may have given buildings without a task.
    assert "No pool" in together({"a": first | {"most_drives": 80}, "b": apart})
    # Which of the two would be part of a joint certificate is open.
    assert "together" not in said
    del apart["seed"]
    assert "b does not name its seed" in together({"a": first, "b": apart})
