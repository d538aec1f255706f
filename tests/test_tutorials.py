"""The code of the tutorials runs, and prints what they say."""

import json
import re
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from PIL import Image

from foresee.checking import check_predictor
from predictor.data.laser_log import LaserLog
from predictor.evaluation.settings import ReplayConfig
from predictor.recording.own_buildings import OwnBuildings
from predictor.registry import load_predictor
from sim import Lidar, LidarConfig, empty_straight

TUTORIALS = Path(__file__).parents[1] / "docs/tutorial"
SAVED = re.compile(r"[Ss]ave this as\s`([\w.]+)`.*?\n```python\n(.*?)^```", re.S | re.M)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A new working folder, as each tutorial asks for."""
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    plt.close("all")


def scripts(page):
    """File name → code of the scripts that a tutorial has its reader save."""
    text = (TUTORIALS / page).read_text()
    found = dict(SAVED.findall(text))
    assert len(found) == text.count("```python")
    return found


@pytest.mark.slow(10)
def test_the_first_drive_is_the_notebook_and_prints_what_the_page_says(folder, capsys):
    notebook = json.loads((TUTORIALS / "drive.ipynb").read_text())
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    code = ["".join(cell["source"]) for cell in cells]
    script = scripts("drive.md")["first_drive.py"]
    assert script == f'{code[0]}\n{code[1]}.savefig("first_drive.png")\n'
    names = {}
    for cell in [script, *code[2:]]:
        exec(cell, names)
    printed = capsys.readouterr().out
    assert f"```\n{printed}```" in (TUTORIALS / "drive.md").read_text()
    assert printed == "".join(cells[0]["outputs"][0]["text"])
    assert np.ptp(Image.open("first_drive.png").convert("L")) > 100


def test_the_predictors_keep_to_the_contract(folder, monkeypatch):
    page = "plug_in_a_predictor.md"
    for name, code in scripts(page).items():
        Path(name).write_text(code)
    monkeypatch.syspath_prepend(folder)
    for name in ("Optimist", "Bold"):
        assert not check_predictor(load_predictor(f"my_module:{name}"))


def test_of_the_drawn_maps_the_one_that_is_driven_in_is_held_out(folder):
    exec(scripts("train_on_your_building.md")["make_maps.py"], {})
    buildings = OwnBuildings.read(("my_maps",))
    assert not buildings.skipped
    assert len(buildings.train) == 3
    assert [Path(path).name for b in buildings.validation for path in b.paths] == ["first.yaml"]


def test_the_picture_of_a_bag_shows_its_maps(folder):
    pytest.importorskip("rosbags", reason="the extra `bags` is not installed")
    from predictor.evaluation.replayed_log import replay

    world, lidar = empty_straight(16.0, 3.0), Lidar(LidarConfig(beams=181))
    poses = np.array([(2.0 + x, 2.0, 0.0) for x in range(3)])
    scans = tuple(lidar.scan(world, pose) for pose in poses)
    log = LaserLog("corridor", scans, poses, np.arange(3.0))
    replay(log, ReplayConfig(predictor="extend"), Path("replayed.mcap"))
    names = {}
    exec(scripts("from_a_bag.md")["picture.py"], names)
    assert [len(grids) for grids in names["maps"].values()] == [3, 3, 3]
    assert [panel.get_title() for panel in names["axes"]] == [
        "/observed",
        "/predicted",
        "/confidence",
    ]
    assert np.ptp(Image.open("prediction.png").convert("L")) > 100
