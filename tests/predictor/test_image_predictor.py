"""The paper's networks as predictors."""

import json

import numpy as np
import pytest
import torch
from safetensors.torch import load, save

from foresee.checking import check_predictor
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame, world_hash
from foresee.prediction import View
from predictor.compact import SHIPPED, Compact
from predictor.image_predictor import SUREST, ImagePredictor
from predictor.networks import ARCHITECTURES
from predictor.networks.compact_net import CompactNet
from predictor.networks.grey_net import GreyNet
from predictor.networks.image_config import ImageConfig
from predictor.provenance import has_learned, weights_fingerprint
from predictor.registry import PredictorError, load_predictor
from predictor.runtime import RUNTIMES
from predictor.weights import WeightsError, load_weights, save_weights

POSE = np.array([5.0, 5.0, 0.7])
CELLS = np.zeros((3, 3), np.int8)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A file of each architecture, untrained, with chances that are none of the greys' own."""
    folder = tmp_path_factory.mktemp("weights")
    for arch in ARCHITECTURES:
        write(folder / f"{arch}.safetensors", arch)
    return folder


def write(path, arch="unet_ff", **changes):
    torch.manual_seed(0)
    net = GreyNet(ImageConfig(arch, **{"expansion": 1.5, "width": 1 / 16, "side": 64} | changes))
    grey = torch.linspace(0.1, 0.5, net.chances.shape[1])
    net.chances.copy_(torch.stack([grey, 0.55 - grey]))
    save_weights(path, net, {"worlds": [world_hash(CELLS)], "validation_worlds": []})
    return path


def seen(side=200, resolution=0.05):
    """A corridor along x through the middle, of which 8 m have been seen."""
    cells = np.full((side, side), UNKNOWN, np.int8)
    middle, half, far = side // 2, round(1.0 / resolution), round(3.0 / resolution)
    cells[middle - half : middle + half, : middle + far] = FREE
    cells[[middle - half - 1, middle + half], : middle + far] = OCCUPIED
    return Grid(GridFrame(resolution, (0.0, 0.0), (side, side)), cells)


@pytest.mark.parametrize("arch", ARCHITECTURES)
def test_every_architecture_keeps_the_contract(folder, arch):
    check_predictor(load_predictor(str(folder / f"{arch}.safetensors")))


@pytest.mark.parametrize("arch", ARCHITECTURES)
def test_openvino_returns_what_torch_returns(folder, arch):
    pytest.importorskip("openvino")
    path = folder / f"{arch}.safetensors"
    fast, plain = (ImagePredictor(path, name).image(View(seen(), POSE)) for name in RUNTIMES)
    assert np.allclose(fast, plain, atol=1e-4)


def test_outside_its_square_it_has_no_confidence(folder):
    known = seen()
    prediction = ImagePredictor(folder / "unet_ff.safetensors").predict(View(known, POSE))
    inside = np.zeros((200, 200), dtype=bool)
    inside[25:175, 25:175] = True
    unseen = known.unknown
    assert (prediction.confidence[unseen & inside] == np.float32(SUREST)).all()
    assert not prediction.confidence[unseen & ~inside].any()
    for values in (prediction.p_free, prediction.p_occupied):
        assert not values[unseen & ~inside].any()


def test_what_was_observed_stays(folder):
    known = seen()
    prediction = ImagePredictor(folder / "gan.safetensors").predict(View(known, POSE))
    assert np.array_equal(prediction.p_free[~known.unknown], known.free[~known.unknown])
    assert np.array_equal(prediction.p_occupied[~known.unknown], known.occupied[~known.unknown])
    assert (prediction.confidence[~known.unknown] == 1).all()


def test_where_nothing_was_seen_there_is_no_confidence(folder):
    known = Grid(GridFrame(0.05, (0.0, 0.0), (200, 200)), np.full((200, 200), UNKNOWN, np.int8))
    prediction = ImagePredictor(folder / "unet_ff.safetensors").predict(View(known, POSE))
    assert not prediction.confidence.any()


def test_probabilities_are_what_its_greys_mean(folder):
    known = seen()
    predictor = ImagePredictor(folder / "unet_ff.safetensors")
    prediction, grey = predictor.predict(View(known, POSE)), predictor.image(View(known, POSE))
    chosen = known.unknown & (prediction.confidence > 0)
    assert np.allclose(prediction.p_free[chosen], 0.3 + 0.2 * grey[chosen], atol=1e-3)
    assert np.allclose(prediction.p_occupied[chosen], 0.25 - 0.2 * grey[chosen], atol=1e-3)


def test_given_the_crop_it_does_not_see_beyond_it(tmp_path):
    known = seen()
    near = Grid(known.frame, known.cells.copy())
    near.cells[:50], near.cells[150:], near.cells[:, :50], near.cells[:, 150:] = 4 * [UNKNOWN]
    for given, same in (("crop", True), ("window", False)):
        predictor = ImagePredictor(write(tmp_path / f"{given}.safetensors", given=given))
        one, other = (predictor.image(View(each, POSE)) for each in (known, near))
        assert np.array_equal(one, other) == same


@pytest.mark.parametrize("resolution", [0.025, 0.05, 0.1])
@pytest.mark.parametrize("expansion", [1.3, 2.0])
def test_what_it_prints_lies_where_it_was_seen_at_every_resolution(tmp_path, resolution, expansion):
    predictor = ImagePredictor(write(tmp_path / "net.safetensors", side=256, expansion=expansion))
    # A network that returns what it is given.
    predictor._run = lambda images: images.astype(np.float32)
    known = seen(round(10 / resolution), resolution)
    image = predictor.image(View(known, POSE))
    at = {(x, y): image[known.frame.cell(x, y)] for x in (2.6, 5.0, 7.4) for y in (4.1, 5.0, 5.9)}
    assert all(value == 1.0 for value in at.values())
    for x in (2.6, 7.4):
        rows = image[:, known.frame.cell(x, 5.0)[1]]
        walls = known.frame.centres()[1][rows == -1.0]
        assert len(walls) >= 2
        assert (abs(abs(walls - 5.0) - 1.0) < 0.05 + resolution).all()
    assert image[known.frame.cell(5.0, 7.0)] == 0.0
    assert image[known.frame.cell(2.3, 5.0)] == 0.0


@pytest.mark.parametrize("turns", range(4))
def test_trained_on_turned_maps_it_turns_them(tmp_path, turns):
    predictor = ImagePredictor(write(tmp_path / "net.safetensors", turned=True))
    known = seen()
    other = Grid(known.frame, np.ascontiguousarray(np.rot90(known.cells, -turns)))
    pose = np.array([5.0, 5.0, 0.1 + turns * np.pi / 2])
    one = predictor.image(View(known, np.array([5.0, 5.0, 0.1])))
    assert np.array_equal(np.rot90(one, -turns), predictor.image(View(other, pose)))


@pytest.mark.parametrize("side", [60, 110, 137, 240])
def test_windows_smaller_and_larger_than_its_square(folder, side):
    known = seen(side)
    pose = np.array([*known.frame.centre(side / 2, side / 2), 0.0])
    prediction = ImagePredictor(folder / "unet_ff.safetensors").predict(View(known, pose))
    assert prediction.p_free.shape == (side, side)
    unseen = known.unknown
    assert (prediction.confidence[unseen] > 0).all() == (side <= 150)


def test_a_file_is_loaded_by_what_it_holds(folder):
    assert isinstance(load_predictor(str(SHIPPED)), Compact)
    predictor = load_predictor(str(folder / "gan.safetensors"))
    assert isinstance(predictor, ImagePredictor)
    assert predictor.config.arch == "gan"


def test_results_can_tell_weights_runtime_and_buildings(folder):
    predictor = load_predictor(str(folder / "mlp.safetensors"))
    facts = predictor.facts
    assert weights_fingerprint(predictor) == f"{facts['fingerprint']} on {facts['runtime']}"
    assert has_learned(predictor, [CELLS])
    assert not has_learned(predictor, [CELLS + 1])


def test_weights_of_another_architecture_are_refused(folder):
    with pytest.raises(WeightsError, match=r"'foresee-gan-1', not of 'foresee-compact-1'"):
        Compact(folder / "gan.safetensors")
    with pytest.raises(WeightsError, match=r"'foresee-compact-4', not of 'foresee-unet_ff-1' or"):
        ImagePredictor(SHIPPED)


def test_a_file_that_is_none_is_one_line(tmp_path):
    path = tmp_path / "odd.safetensors"
    with pytest.raises(PredictorError, match="does not exist"):
        load_predictor(str(path))
    path.write_bytes(save({"a": torch.zeros(3)}))
    with pytest.raises(PredictorError, match="broken header") as raised:
        load_predictor(str(path))
    assert "\n" not in str(raised.value)
    path.write_bytes(
        save({"a": torch.zeros(3)}, {"architecture": "x", "facts": "{}", "fingerprint": ""})
    )
    with pytest.raises(
        PredictorError, match=r"'x', known are foresee-compact-1, .*foresee-unet_ff-1"
    ):
        load_predictor(str(path))


def test_truncated_and_changed_weights(folder, tmp_path):
    data = (folder / "unet_ff.safetensors").read_bytes()
    path = tmp_path / "unet_ff.safetensors"
    path.write_bytes(data[:5000])
    with pytest.raises(WeightsError, match="damaged"):
        load_weights(path, GreyNet)
    header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])["__metadata__"]
    tensors = load(data)
    tensors["chances"][0, 0] += 0.1
    path.write_bytes(save(tensors, header))
    with pytest.raises(WeightsError, match="not those that were written"):
        load_weights(path, GreyNet)


@pytest.mark.parametrize(
    "change",
    [{"arch": "resnet_ff"}, {"width": 1e9}, {"side": 96}, {"side": "64"}, {"more": 1}, {"arch": 3}],
)
def test_a_header_of_an_impossible_network(folder, tmp_path, change):
    data = (folder / "unet_ff.safetensors").read_bytes()
    header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])["__metadata__"]
    header["config"] = json.dumps(json.loads(header["config"]) | change)
    path = tmp_path / "odd.safetensors"
    path.write_bytes(save(load(data), header))
    with pytest.raises(WeightsError, match="broken header"):
        load_weights(path, GreyNet)


def test_weights_of_compact_come_back_through_the_same_door(tmp_path):
    path = tmp_path / "compact.safetensors"
    save_weights(path, CompactNet(), {})
    assert isinstance(load_predictor(str(path)), Compact)
