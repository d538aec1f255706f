"""The tables of results files."""

import json
import re
from pathlib import Path
from pkgutil import resolve_name

from comparison import results

from benchmarks import tables
from benchmarks.runs import overview
from foresee.infra.results_file import COMMANDS


def test_the_tables_of_a_run_are_markdown(narrow, tmp_path, capsys):
    out, _ = narrow
    assert tables.main([str(out / "results.json")]) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("|")]
    assert "`known`" in lines[0]
    assert len({line.count("|") for line in lines}) == 1
    assert len({len(line) for line in lines}) == 1
    entry = results(out)["summary"]["known"]
    assert "SCT" in lines[2]
    assert f"{entry['sct']:.3f}" in lines[2]
    assert any("speed [m/s]" in line and f"{entry['mean_speed']:.2f}" in line for line in lines)
    (tmp_path / "foreign.json").write_text("[1, 2]")
    for name in ("foreign.json", "missing.json"):
        assert tables.main([str(tmp_path / name)]) == 2
        assert name in capsys.readouterr().err


def test_the_tables_of_older_results_have_what_can_be_said_of_them(capsys):
    folder = Path(__file__).parents[2] / "docs/results"
    files = [folder / f"{name}.json" for name in ("corridor-5m", "corridor-fixed-5m")]
    older = json.loads(files[0].read_text())
    for episode in older["episodes"]:
        for name in ("sct", "t_bound", "t_opt", "detour", "shortest_length", "vehicle"):
            episode.pop(name, None)
    for name in ("vehicle", "reliance", "level", "fixed_level"):
        older["settings"].pop(name)
    # The reliance was called so.
    older["settings"]["risk"] = 0.07
    text = tables.file_tables(overview.summarised(older))
    assert "reliance 0.07\n" in text
    assert "dubins car" in text
    ratio = next(line for line in text.splitlines() if "time ratio" in line)
    assert re.search(r"0\.\d\d \(0\.\d\d–\d\.\d\d\)", ratio)
    sct = next(line for line in text.splitlines() if "SCT" in line)
    assert not "".join(sct.split("|")[2:]).strip()
    assert tables.main([str(path) for path in files]) == 0
    assert "## Overview" in capsys.readouterr().out
    assert tables.main(["--overview", str(folder / "weave.json")]) == 2
    assert "no file has drives" in capsys.readouterr().err


def test_the_tables_of_runs_have_the_reliance_beside_what_became_of_it(capsys):
    files = sorted((Path(__file__).parents[2] / "docs/results/reliance").glob("mixture-*.json"))
    assert len(files) > 1
    assert tables.main([str(path) for path in files]) == 0
    text = capsys.readouterr().out
    rows = [
        line.split("|") for line in text.split("## Reliances")[1].split("##")[0].splitlines()[4:]
    ]
    rows = [[cell.strip() for cell in row] for row in rows if len(row) > 1]
    assert [row[1] for row in rows] == [path.stem for path in files]
    for row, path in zip(rows, files, strict=True):
        assert float(row[4]) == json.loads(path.read_text())["settings"]["reliance"]
        value, low, high = re.fullmatch(r"(.+) \((.+)–(.+)\) %", row[5]).groups()
        assert float(low) < float(value) < float(high)


def at_a_risk(calibrated, revision, arm="predicted"):
    """Return the contents of a results file whose drives of an arm are at a risk."""
    path = Path(__file__).parents[2] / "docs/results/trap-fixed-5m.json"
    content = json.loads(path.read_text())
    for episode in content["episodes"]:
        episode["revision"] = revision
        if episode["arm"] == arm:
            episode["calibrated"] = calibrated
    return overview.summarised(content)


def heads(content):
    table = tables.file_tables(content).split("\n\n")[1]
    return [cell.strip() for cell in table.splitlines()[0].strip("|").split("|")][1:]


def test_the_head_of_a_column_says_that_its_calibration_is_of_an_earlier_planner():
    earlier = "`predicted`, calibrated with an earlier planner"
    assert heads(at_a_risk(1, 2)) == ["`known`", earlier, "`full`"]
    for calibrated in (2, None):
        assert heads(at_a_risk(calibrated, 2)) == ["`known`", "`predicted`", "`full`"]


def test_the_overview_says_that_a_calibration_is_of_an_earlier_planner():
    assert "| run, calibrated with an earlier planner" in overview.overview(
        {"run": at_a_risk(1, 2)}
    )
    assert "earlier" not in overview.overview({"run": at_a_risk(2, 2)})


def test_the_overview_has_a_ratio_for_each_arm_that_drove():
    runs = {"one": at_a_risk(None, 2), "other": at_a_risk(None, 2)}
    del runs["other"]["summary"]["full"]
    head, _, one, other = (
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in overview.overview(runs).splitlines()
    )
    ratios = [head.index(f"`{arm}` / `known`") for arm in ("predicted", "full")]
    assert one[ratios[0]] == other[ratios[0]] == "0.89 (0.87–0.90)"
    assert other[ratios[1]] == "–"
    assert one[head.index("reached")] == "20 / 20 / 20"
    assert other[head.index("reached")] == "20 / 20 / –"


def test_each_kind_of_results_has_its_tables():
    assert set(tables.TABLES) == set(COMMANDS)
    assert all(callable(resolve_name(home)) for home in tables.TABLES.values())


def test_files_of_the_same_name_are_told_apart(tmp_path, capsys):
    source = Path(__file__).parents[2] / "docs/results/weave.json"
    paths = [tmp_path / name for name in ("a/results.json", "b/results.json", "c/b/results.json")]
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(source.read_text())

    def headings(*files):
        assert tables.main([str(file) for file in files]) == 0
        lines = capsys.readouterr().out.splitlines()
        return [line[3:] for line in lines if line.startswith("## ")]

    assert headings(paths[0], source) == ["results", "weave"]
    assert headings(*paths[:2], paths[0]) == ["a/results", "b/results"]
    assert headings(*paths) == ["a/results", str(paths[1]), str(paths[2])]
