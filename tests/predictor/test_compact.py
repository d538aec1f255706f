"""The compact network and the predictor that runs it."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

from foresee.checking import check_predictor
from foresee.mapping.context import CELLS
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from foresee.mapping.resampling import resampled
from foresee.prediction import View
from predictor.compact import LOGS, PAPER, SHIPPED, Compact
from predictor.networks.compact_net import CompactConfig, CompactNet, ContextNet, room_masks
from predictor.provenance import weights_fingerprint
from predictor.registry import load_predictor
from predictor.runtime import RUNTIMES, runner
from predictor.training.compact_targets import known_input, losses, room_targets
from predictor.weights import load_weights, save_weights

CARDS = Path(__file__).parents[2] / "docs/reference/cards"


@pytest.fixture(scope="module")
def compact():
    return Compact()


def corridor(side=200, resolution=0.05):
    """Two walls 2 m apart along x, seen up to the middle and 2 m further."""
    cells = np.full((side, side), UNKNOWN, np.int8)
    middle, half, far = side // 2, round(1.0 / resolution), round(2.0 / resolution)
    cells[middle - half : middle + half, : middle + far] = FREE
    cells[[middle - half - 1, middle + half], : middle + far] = OCCUPIED
    return Grid(GridFrame(resolution, (0.0, 0.0), (side, side)), cells)


def random_map(shape, seed=0):
    rng = np.random.default_rng(seed)
    coarse = rng.choice(np.array([FREE, UNKNOWN, OCCUPIED], np.int8), (9, 9), p=[0.5, 0.4, 0.1])
    cells = np.kron(coarse, np.ones((40, 40), np.int8))[: shape[0], : shape[1]]
    return Grid(GridFrame(0.05, (1.0, 2.0), shape), np.ascontiguousarray(cells))


def centre_pose(grid, yaw=0.0):
    rows, cols = grid.frame.shape
    return np.array([*grid.frame.centre(rows / 2, cols / 2), yaw])


def card_of(weights):
    return (CARDS / f"{weights.stem}.md").read_text()


def test_it_is_as_small_as_promised():
    assert sum(p.numel() for p in CompactNet().parameters()) <= 1_500_000
    assert max(path.stat().st_size for path in (SHIPPED, LOGS, PAPER)) <= 8_000_000


@pytest.mark.parametrize(
    ("name", "weights"),
    [("compact-logs", LOGS), ("compact-paper", PAPER)],
)
def test_what_learned_on_goes_by_its_own_name(name, weights):
    predictor = load_predictor(name)
    assert isinstance(predictor, Compact)
    assert predictor.weights == weights
    assert predictor.facts["before"]["fingerprint"] in card_of(weights)
    check_predictor(predictor)


@pytest.mark.parametrize("weights", [SHIPPED, LOGS, PAPER])
def test_the_card_beside_weights_is_theirs(weights):
    card = card_of(weights)
    facts = Compact(weights).facts
    assert facts["fingerprint"] in card
    metadata = yaml.safe_load(card.split("---\n")[1])
    assert metadata["license"] == "mit"
    (index,) = metadata["model-index"]
    assert index["name"] == weights.stem
    (result,) = index["results"]
    measured = facts["validation"]
    for metric in result["metrics"]:
        assert metric["value"] == pytest.approx(measured[metric["type"]], abs=5e-4)


@pytest.mark.parametrize("shape", [(40, 40), (200, 200), (280, 120)])
def test_the_network_keeps_the_shape_of_its_input(shape):
    assert CompactNet().eval()(torch.zeros(2, 2, *shape)).shape == (2, 4, *shape)


def test_folding_the_normalisation_changes_no_output():
    torch.manual_seed(0)
    net = CompactNet()
    known = torch.rand(4, 2, 80, 80)
    net.train()(known)
    before = net.eval()(known)
    assert torch.allclose(net.folded()(known), before, atol=1e-4)


@pytest.fixture(scope="module")
def floats(tmp_path_factory):
    """Path of the shipped network in floating-point numbers."""
    net, facts = load_weights(SHIPPED, CompactNet)
    assert net.config.quantised
    path = tmp_path_factory.mktemp("floats") / "floats.safetensors"
    save_weights(path, net.with_ranges(None), facts)
    return path


@pytest.mark.parametrize("shape", [(2, 2), (10, 14), (32, 30), (40, 34), (44, 38)])
def test_the_part_of_the_context_that_is_left_out_does_not_matter(shape):
    torch.manual_seed(0)
    net = ContextNet(8, 6).eval()
    torch.nn.init.normal_(net.here.weight)
    context = torch.rand(1, 2, CELLS, CELLS)

    # The largest shape for which all of the context is computed.
    whole, summary = net(context, 40, 40)
    part, same = net(context, *shape)

    rows, cols = (np.clip(np.arange(n) + (40 - n) // 2, 0, 39) for n in shape)
    torch.testing.assert_close(part, whole[:, :, rows][..., cols])
    assert torch.equal(same, summary)


@pytest.mark.parametrize("shape", [(200, 200), (273, 150)])
def test_openvino_gives_the_answers_of_torch(shape, floats):
    pytest.importorskip("openvino")
    view = View(random_map(shape), centre_pose(random_map(shape)))
    for name in ("p_free", "p_occupied", "confidence"):
        fast, plain = (getattr(Compact(floats, one).predict(view), name) for one in RUNTIMES)
        assert np.allclose(fast, plain, atol=1e-4)
        # Sums near the middle between two integers are rounded to either.
        fast, plain = (getattr(Compact(runtime=one).predict(view), name) for one in RUNTIMES)
        assert np.abs(fast - plain).mean() < 1e-3


def openvino_answers():
    """Answers for maps of which half have sums near the middle between two integers."""
    network = Compact(runtime="openvino")
    maps = [random_map((200, 200), seed) for seed in range(10)]
    answers = [network.predict(View(one, centre_pose(one, yaw=0.3))) for one in maps]
    return np.array([(one.p_free, one.p_occupied, one.confidence) for one in answers])


class Compiling:
    """A predictor of somebody else, which compiles a network before `compact` does."""

    def __init__(self):
        import openvino as ov
        from openvino import opset15 as ops

        given = ops.parameter([1, 1], np.float32)
        ov.Core().compile_model(ov.Model([ops.abs(given)], [given]), "CPU")

    def predict(self, view):
        raise NotImplementedError


@pytest.mark.slow(10)
def test_openvino_gives_the_same_answers_on_all_processors_and_after_other_networks(tmp_path):
    pytest.importorskip("openvino")
    other = "from predictor.registry import load_predictor\n"
    other += "load_predictor('tests.predictor.test_compact:Compiling')\n"
    answer = "import sys, numpy, tests.predictor.test_compact as test\n"
    answer += "numpy.save(sys.argv[1], test.openvino_answers())"
    older = {"ONEDNN_MAX_CPU_ISA": "AVX2"}
    answers = []
    for program, instructions in (answer, older), (other + answer, {}):
        subprocess.run(
            [sys.executable, "-c", program, tmp_path / "answers.npy"],
            cwd=CARDS.parents[2],
            env=os.environ | instructions,
            check=True,
        )
        answers.append(np.load(tmp_path / "answers.npy"))
    assert np.array_equal(*answers)


def test_the_instructions_are_not_limited_for_other_libraries(compact):
    compact.predict(View(corridor(), centre_pose(corridor())))
    assert "ONEDNN_MAX_CPU_ISA" not in os.environ


def test_integers_hardly_change_the_answers(floats):
    view = View(corridor(), centre_pose(corridor()))
    for name in ("p_free", "p_occupied", "confidence"):
        exact, rounded = (getattr(Compact(path).predict(view), name) for path in (floats, SHIPPED))
        assert 0.0 < np.abs(exact - rounded).mean() < 0.03
    assert Compact(floats).predict(view).doubt == Compact().predict(view).doubt


def test_a_runtime_that_does_not_exist_is_named():
    with pytest.raises(ValueError, match=r"'onnx'.*openvino, torch"):
        Compact(runtime="onnx")


def test_results_can_tell_the_runtime(compact):
    assert (
        weights_fingerprint(compact)
        == f"{compact.facts['fingerprint']} on {compact.facts['runtime']}"
    )
    assert compact.facts["runtime"].split()[0] in RUNTIMES


@pytest.mark.parametrize("shape", [(200, 200), (110, 150), (273, 273), (7, 3)])
def test_every_size_of_window_gets_probabilities(compact, shape):
    grid = random_map(shape)
    prediction = compact.predict(View(grid, centre_pose(grid, 0.3)))
    for name in ("p_free", "p_occupied", "confidence"):
        values = getattr(prediction, name)
        assert values.shape == shape
        assert values.dtype == np.float32
        assert ((values >= 0) & (values <= 1)).all()
    assert (prediction.p_free + prediction.p_occupied <= 1 + 1e-5).all()


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_turning_the_building_and_the_car_turns_the_prediction(compact, turns):
    grid = random_map((200, 200))
    # Counter-clockwise in the world, where rows grow upwards.
    turned = Grid(grid.frame, np.ascontiguousarray(np.rot90(grid.cells, -turns)))
    plain = compact.predict(View(grid, centre_pose(grid, 0.1)))
    other = compact.predict(View(turned, centre_pose(grid, 0.1 + turns * np.pi / 2)))
    for name in ("p_free", "p_occupied", "confidence"):
        assert np.allclose(np.rot90(getattr(plain, name), -turns), getattr(other, name), atol=1e-5)


def test_a_corridor_is_believed_to_go_on(compact):
    grid = corridor()
    prediction = compact.predict(View(grid, centre_pose(grid)))
    ahead = prediction.p_free[95:105, 142:150]
    inside_the_wall = prediction.p_free[60:70, 110:130]
    assert ahead.mean() > 0.8
    assert inside_the_wall.mean() < 0.5
    far = prediction.p_free[95:105, 185:195]
    assert far.mean() < ahead.mean()


def test_confidence_leaves_less_than_p_free_beside_walls(compact):
    grid = corridor()
    prediction = compact.predict(View(grid, centre_pose(grid)))
    trust = prediction.confidence * prediction.p_free
    unseen = grid.unknown
    assert (trust[unseen] <= prediction.p_free[unseen] + 1e-6).all()
    assert trust[100, 145] > trust[81, 145]


@pytest.mark.parametrize(
    ("chances", "doubt", "runtime"),
    [
        ((1.0, 0.0, 0.0), 1.0, "torch"),
        ((0.0, 1.0, 0.0), 30.0, "torch"),
        # The mean, where no kind is likely.
        ((0.7, 0.2, 0.1), 7.3, "torch"),
        # The largest of the likely ones.
        *(((0.1, 0.45, 0.45), 30.0, runtime) for runtime in RUNTIMES),
    ],
)
def test_the_kind_of_building_changes_the_doubt_alone(tmp_path, chances, doubt, runtime):
    net, facts = load_weights(SHIPPED, CompactNet)
    told = net.with_kinds(("corridor", "narrow", "floor_plan"))
    with torch.no_grad():
        told.kinds.weight.zero_()
        told.kinds.bias.copy_(torch.log(torch.tensor(chances) + 1e-9))
        told.doubts.copy_(torch.tensor([1.0, 30.0, 6.0]))
    save_weights(tmp_path / "told.safetensors", told, facts)
    view = View(corridor(), centre_pose(corridor()))
    before, after = (
        Compact(path, runtime).predict(view) for path in (SHIPPED, tmp_path / "told.safetensors")
    )
    assert np.abs(before.p_free - after.p_free).max() < 1e-5
    assert np.abs(before.confidence - after.confidence).max() < 1e-5
    assert after.doubt == pytest.approx(doubt, rel=1e-4)


def test_of_what_was_not_seen_it_is_never_certain(compact):
    for grid in (corridor(), random_map((200, 200))):
        prediction = compact.predict(View(grid, centre_pose(grid)))
        assert (prediction.confidence[grid.unknown] < 0.99995).all()
        assert (prediction.confidence[~grid.unknown] == 1.0).all()


def test_where_nothing_was_seen_there_is_no_confidence(compact):
    grid = Grid(GridFrame(0.05, (0.0, 0.0), (200, 200)), np.full((200, 200), UNKNOWN, np.int8))
    assert not compact.predict(View(grid, centre_pose(grid))).confidence.any()


@pytest.mark.parametrize("resolution", [0.025, 0.1])
def test_maps_of_other_resolutions_are_predicted_alike(compact, resolution):
    plain = compact.predict(View(corridor(), np.array([5.0, 5.0, 0.0])))
    grid = corridor(round(10 / resolution), resolution)
    other = compact.predict(View(grid, np.array([5.0, 5.0, 0.0])))
    assert other.p_free.shape == grid.frame.shape
    at = [(x, y) for x in (7.3, 8.0, 9.0) for y in (4.5, 5.0, 5.5)]
    for x, y in at:
        a = plain.p_free[plain.frame.cell(x, y)]
        b = other.p_free[other.frame.cell(x, y)]
        assert abs(a - b) < 0.2


@pytest.mark.parametrize("resolution", [0.02, 0.025, 0.04, 0.05, 0.1])
def test_no_wall_is_lost_between_resolutions(resolution):
    for at in range(12):
        cells = np.full((24, 24), FREE, np.int8)
        cells[:, at] = OCCUPIED
        seen, _, _ = resampled(Grid(GridFrame(resolution, (0.0, 0.0), (24, 24)), cells), 0.05)
        assert seen.occupied.any(axis=1).all()


def test_losses_count_only_what_was_not_seen():
    codes = torch.zeros(1, 40, 40, dtype=torch.uint8)
    codes[:, :, 20:] = 2 + 3 * 2  # Not seen, never observable.
    logits = torch.zeros(1, 4, 40, 40)
    logits[:, 2, :, 20:] = 20.0
    logits[:, 3, :, 17:] = -20.0
    logits[:, 2, :, :17] = 20.0  # Wrong where it was seen: no matter.
    assert all(float(loss) == pytest.approx(0.0, abs=1e-6) for loss in losses(logits, codes))
    assert float(losses(-logits, codes)[0]) > 10


def test_room_is_a_free_square_as_wide_as_the_car():
    codes = torch.full((1, 30, 30), 2, dtype=torch.uint8)  # Not seen, free.
    codes[0, 15, 15] = 2 + 3  # Not seen, a surface.
    room, asked = room_targets(codes)
    assert asked.all()
    assert not room[0, 12:19, 12:19].any()
    assert int((~room).sum()) == 49


def test_squares_that_reach_out_of_the_map_are_not_asked_for():
    codes = torch.full((1, 30, 30), 2, dtype=torch.uint8)  # Not seen, free.
    logits = torch.zeros(1, 4, 30, 30)
    inside = logits.clone()
    inside[:, 3, 3:-3, 3:-3] = 20.0  # Right, where it counts.
    inside[:, 3, :3], inside[:, 3, -3:] = -20.0, -20.0
    assert float(losses(inside, codes)[1]) == pytest.approx(0.0, abs=1e-6)
    assert float(losses(logits, codes)[1]) == pytest.approx(np.log(2), abs=1e-5)


def test_what_was_seen_settles_the_question_of_room():
    seen = torch.zeros(1, 30, 30, dtype=torch.uint8)
    seen[0, :, 20:], seen[0, 5, 5] = 2, 1
    barred, asked = room_masks(seen)
    assert barred[0, 5, 8]
    assert not asked[0, 5, 8]
    assert not asked[0, 15, 10]
    assert asked[0, 15, 18]


def test_the_input_has_a_channel_for_each_thing_seen():
    codes = torch.tensor([[[0, 1, 2], [3, 4, 5], [6, 7, 8]]], dtype=torch.uint8)
    known = known_input(codes)
    assert known[0, 0].tolist() == [[1, 0, 0]] * 3
    assert known[0, 1].tolist() == [[0, 1, 0]] * 3


def test_an_interrupt_while_openvino_converts_the_network_is_an_interrupt(monkeypatch):
    pytest.importorskip("openvino")
    trace = torch.jit.trace

    def interrupted(*args, **options):
        signal.raise_signal(signal.SIGINT)
        return trace(*args, **options)

    monkeypatch.setattr(torch.jit, "trace", interrupted)
    # A worker of pytest-xdist ignores the signal.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            runner(torch.nn.Identity(), "openvino", (4, 4))
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_doubt_is_at_least_one_whatever_the_rounding():
    net = CompactNet(CompactConfig(context=16, kinds=("corridor", "office", "paper")))
    chances = torch.randn(1000, 3, generator=torch.Generator().manual_seed(0))
    assert (net.doubt(20.0 * chances) >= 1.0).all()
