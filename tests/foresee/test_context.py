"""The context: what a predictor is told of besides the square that it predicts."""

import numpy as np
import pytest
import torch
from short_drive import drive, navigator, straight

from foresee.checking import check_predictor
from foresee.mapping.context import CELLS, SIDE
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from foresee.prediction import BadPredictionError, Prediction, View
from predictor.compact import Compact
from predictor.networks.compact_net import CompactNet
from predictor.runtime import RUNTIMES
from predictor.training.compact_targets import contexts
from predictor.weights import load_weights, save_weights
from sim.episode import EpisodeConfig


def trained_on_nothing(width=8):
    """A network whose context matters: random weights in place of the first ones, which are 0."""
    torch.manual_seed(1)
    net = CompactNet().with_context(width)
    for last in (net.context.here, net.context.everywhere):
        torch.nn.init.normal_(last.weight, std=0.3)
    return net.eval()


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    path = tmp_path_factory.mktemp("weights") / "context.safetensors"
    save_weights(path, trained_on_nothing(), {})
    return path


def rooms(side, seed=0):
    """A random map, the middle of which holds free, occupied and unobserved cells."""
    rng = np.random.default_rng(seed)
    coarse = rng.choice(np.array([FREE, OCCUPIED, UNKNOWN], np.int8), (side // 20, side // 20))
    return Grid(
        GridFrame(0.05, (3.0, -2.0), (side, side)), np.kron(coarse, np.ones((20, 20), "i1"))
    )


def middle_of(grid, side):
    rows, cols = grid.frame.shape
    x, y = grid.frame.centre(0.5 * (rows - 1), 0.5 * (cols - 1))
    return grid.crop(grid.frame.square(x, y, side)), np.array([x, y, 0.0])


def test_a_context_that_is_added_to_a_network_changes_nothing_at_first():
    torch.manual_seed(0)
    net = CompactNet().eval()
    known, context = torch.rand(2, 2, 80, 120), torch.rand(2, 2, CELLS, CELLS)
    more = net.with_context(16).eval()
    assert torch.equal(more(known, context), net(known))
    assert more.with_context(16) is more
    assert (net.architecture, more.architecture) == net.ARCHITECTURES[:2]


def test_weights_with_a_context_come_back(weights):
    net, _ = load_weights(weights, CompactNet)
    assert net.config.context == 8
    wanted = trained_on_nothing().state_dict()
    assert all(torch.equal(values, wanted[name]) for name, values in net.state_dict().items())


@pytest.mark.parametrize("shape", [(40, 40), (280, 120), (840, 80)])
def test_the_context_serves_maps_of_every_size(shape):
    net = trained_on_nothing()
    context = torch.rand(1, 2, CELLS, CELLS)
    assert net(torch.zeros(1, 2, *shape), context).shape == (1, 4, *shape)


@pytest.mark.parametrize("runtime", RUNTIMES)
def test_what_lies_beyond_the_square_changes_the_prediction(weights, runtime):
    pytest.importorskip(runtime)
    predictor = Compact(weights, runtime)
    assert predictor.context_side == SIDE
    around = rooms(800)
    known, pose = middle_of(around, 10.0)
    blank = Grid(around.frame, np.full_like(around.cells, UNKNOWN))
    here, nothing = (predictor.predict(View(known, pose, one)).p_free for one in (around, blank))
    assert abs(here - nothing).max() > 1e-3
    # Without a context, the square itself is all that is known.
    alone = Grid(around.frame, blank.cells.copy())
    rows, cols = np.indices(known.cells.shape) + 300
    alone.cells[rows, cols] = known.cells
    assert np.array_equal(
        predictor.predict(View(known, pose)).p_free,
        predictor.predict(View(known, pose, alone)).p_free,
    )


def test_openvino_gives_the_answers_of_torch_with_a_context_too(weights):
    pytest.importorskip("openvino")
    around = rooms(800, 3)
    for side in (10.0, 7.0):
        known, pose = middle_of(around, side)
        fast, plain = (
            Compact(weights, name).predict(View(known, pose, around)) for name in RUNTIMES
        )
        assert np.allclose(fast.p_free, plain.p_free, atol=1e-4)


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_turning_the_building_and_the_car_turns_the_prediction(weights, turns):
    predictor, around = Compact(weights, "torch"), rooms(800, 5)
    known, pose = middle_of(around, 10.0)
    turned = Grid(around.frame, np.ascontiguousarray(np.rot90(around.cells, -turns)))
    other, _ = middle_of(turned, 10.0)
    yaw = np.array([0.0, 0.0, 0.5 * np.pi * turns])
    first = predictor.predict(View(known, pose, around)).p_free
    second = predictor.predict(View(other, pose + yaw, turned)).p_free
    assert np.allclose(np.rot90(first, -turns), second, atol=1e-5)


def test_in_training_some_samples_are_without_what_lies_beyond_their_square():
    coarse = torch.full((2, 2, CELLS, CELLS), 50, dtype=torch.uint8)
    coarse[0, :, : CELLS // 2] = 100
    first, second = torch.tensor([True, False]), torch.tensor([False, True])
    out = contexts(coarse, first, second, 200)
    assert out.shape == (2, 2, CELLS, CELLS)
    assert out[0, 0, 0, 0] == 0.5
    assert out[0, 0, -1, 0] == 1.0
    assert out[1].sum() == pytest.approx(2 * 20 * 20 * 0.5)
    assert contexts(coarse, first & second, first & second, 200)[1].min() == 0.5


def test_the_contract_holds_for_a_predictor_with_a_context(weights):
    assert not [line for line in check_predictor(Compact(weights)) if "late" not in line]


class LooksFar:
    """A predictor that notes how much it was shown, and changes it."""

    def __init__(self):
        self.sizes = set()

    def predict(self, view):
        known, around = view.known, view.around
        self.sizes.add(around.frame.size)
        nothing = np.zeros(known.frame.shape, np.float32)
        around.cells[:] = FREE
        object.__setattr__(view, "known", around)
        return Prediction(known.frame, nothing, nothing, nothing)


class Looks(LooksFar):
    context_side = 12.0


class LooksNearby(LooksFar):
    context_side = 0


@pytest.mark.parametrize(("kind", "side"), [(Looks, 12.0), (LooksFar, SIDE), (LooksNearby, 10.0)])
def test_the_planner_hands_over_the_context_as_a_copy(kind, side):
    task, looks = straight(), kind()
    config = EpisodeConfig(timeout=0.5)
    seen = drive(task, navigator(task, looks, reliance=0.1), config)
    assert looks.sizes == {(side, side)}
    plain = drive(task, navigator(task, None), config)
    assert np.array_equal(seen.trace["states"], plain.trace["states"])


class Raises(Looks):
    @property
    def context_side(self):
        raise OSError("no")


def test_a_context_side_that_raises_is_a_broken_contract():
    with pytest.raises(BadPredictionError, match="context_side raised"):
        navigator(straight(), Raises(), reliance=0.1)


def test_a_predictor_that_writes_into_its_context_breaks_the_contract():
    with pytest.raises(BadPredictionError, match="changed the map"):
        check_predictor(Looks())


def test_a_predictor_is_checked_in_squares_of_the_side_that_it_states():
    looks = Looks()
    looks.side, asked = 4.0, set()

    def predict(view):
        asked.add(view.known.frame.shape)
        field = np.zeros(view.known.frame.shape, np.float32)
        return Prediction(view.known.frame, field, field, field)

    looks.predict = predict
    assert check_predictor(looks) == ()
    assert max(max(shape) for shape in asked) * 0.05 == pytest.approx(4.0, abs=0.06)
    assert min(min(shape) for shape in asked) * 0.05 == pytest.approx(4.0, abs=0.06)


@pytest.mark.parametrize("side", [-1.0, 1e9, float("nan"), "wide", None])
def test_a_context_that_is_no_length_is_refused(side):
    looks = Looks()
    looks.context_side = side
    with pytest.raises(BadPredictionError, match="context_side is"):
        navigator(straight(), looks, reliance=0.1)
    with pytest.raises(BadPredictionError, match="context_side is"):
        check_predictor(looks)


@pytest.mark.parametrize("side", [5.0, 10.0, 60.0])
def test_the_context_may_be_of_any_size(weights, side):
    around = rooms(1200)
    known, pose = middle_of(around, 5.0)
    whole, _ = middle_of(around, side)
    wanted, _ = middle_of(whole, SIDE)
    predictor = Compact(weights)
    answers = (predictor.predict(View(known, pose, each)) for each in (whole, wanted))
    assert np.array_equal(*(answer.p_free for answer in answers))
