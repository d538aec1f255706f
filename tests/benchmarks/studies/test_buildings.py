"""The comparison of buildings by numbers."""

import json

from benchmarks.studies import buildings
from sim.families import empty_straight
from sim.map_server import save_world


def test_families_and_maps_are_groups_of_one_table(tmp_path, capsys):
    (tmp_path / "halls").mkdir()
    for name, width in (("narrow", 2.0), ("wide", 5.0)):
        save_world(empty_straight(30.0, width), tmp_path / "halls" / f"{name}.yaml")
    out = tmp_path / "buildings.json"
    words = ["--world", "narrow", str(tmp_path / "halls"), "--buildings", "3", "--out", str(out)]
    assert buildings.main(words) == 0
    results = json.loads(out.read_text())
    assert [len(of) for of in results["groups"].values()] == [3, 2]
    assert [numbers["area"] for numbers in results["groups"]["halls"]] == [60.0, 150.0]
    printed = capsys.readouterr().out
    assert buildings.table(results) in printed
    assert "| free area [m²]" in printed
    assert "105 (82–128)" in printed


def test_a_map_that_is_not_there_is_refused_in_a_line(tmp_path, capsys):
    assert buildings.main(["--world", str(tmp_path / "none.yaml")]) == 2
    assert "no such file" in capsys.readouterr().err
