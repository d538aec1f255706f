"""Networks of several expansions in one predictor."""

import numpy as np
import pytest
import torch

from foresee.checking import check_predictor
from foresee.mapping.grid import UNKNOWN, Grid, GridFrame
from foresee.prediction import View
from predictor.fused import Fused
from predictor.image_predictor import ImagePredictor
from predictor.networks.grey_net import GreyNet
from predictor.networks.image_config import ImageConfig
from predictor.provenance import weights_fingerprint
from predictor.registry import PredictorError, load_predictor
from predictor.weights import WeightsError, save_weights

POSE = np.array([5.0, 5.0, 0.3])


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    for seed, expansion in enumerate((1.1, 1.5, 2.0)):
        write(folder, expansion, seed=seed)
    return folder


def write(folder, expansion, seed=0, **changes):
    torch.manual_seed(seed)
    net = GreyNet(ImageConfig("unet_ff", expansion, width=1 / 16, side=64, **changes))
    path = folder / f"unet_ff-{expansion}{changes.get('given', '')}" / "unet_ff.safetensors"
    path.parent.mkdir()
    save_weights(path, net, {"worlds": [str(seed)], "validation_worlds": []})
    return path


def known(side=200):
    cells = np.random.default_rng(0).choice(np.array([0, 0, 100, -1], np.int8), size=(side, side))
    return Grid(GridFrame(0.05, (5.0 - side / 40, 5.0 - side / 40), (side, side)), cells)


def alone(study, expansion):
    return ImagePredictor(study / f"unet_ff-{expansion}" / "unet_ff.safetensors")


def test_of_each_cell_speaks_the_network_of_the_smallest_square_that_holds_it(study):
    fused = load_predictor(f"fused:{study}/unet_ff").grey_layers(View(known(), POSE))
    beyond = np.maximum.outer(*2 * [abs(np.arange(200) + 0.5 - 100)])
    for low, expansion in ((0, 1.1), (55, 1.5), (75, 2.0)):
        ring = (beyond > low) & (beyond < 50 * expansion)
        np.testing.assert_array_equal(
            fused[:, ring], alone(study, expansion).grey_layers(View(known(), POSE))[:, ring]
        )


def test_in_a_window_that_the_nearest_fills_it_speaks_alone(study):
    fused, nearest = load_predictor(f"fused:{study}/unet_ff"), alone(study, 1.1)
    np.testing.assert_array_equal(
        fused.predict(View(known(110), POSE)).p_free, nearest.predict(View(known(110), POSE)).p_free
    )


def test_it_keeps_the_contract_and_says_where_it_comes_from(study):
    fused = load_predictor(f"fused:{study}/unet_ff")
    check_predictor(fused)
    assert fused.facts["worlds"] == ["0", "1", "2"]
    assert weights_fingerprint(fused) != weights_fingerprint(Fused(fused.weights[:2]))
    blind = Grid(known().frame, np.full((200, 200), UNKNOWN, np.int8))
    assert not fused.predict(View(blind, POSE)).confidence.any()


def test_what_cannot_be_fused_is_refused(study, tmp_path):
    with pytest.raises(PredictorError, match="two at least"):
        load_predictor(f"fused:{study}/gan")
    paths = [write(tmp_path, 1.3), write(tmp_path, 1.7, given="window")]
    with pytest.raises(WeightsError, match="given the same"):
        Fused(paths)
    with pytest.raises(WeightsError, match="another expansion"):
        Fused([paths[0], paths[0]])
