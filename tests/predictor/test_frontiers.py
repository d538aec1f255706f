"""Frontiers: where they are, what trying them costs, how they steer, and how they are learned."""

import itertools
import math
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from rooms import CAR, Room
from short_drive import drive, navigator, straight

from benchmarks.compare import drive as compare
from benchmarks.runs.arms import ARMS
from benchmarks.runs.settings import Settings
from foresee.frontiers import FrontierValues
from foresee.infra.command_line import UsageError
from foresee.mapping.grid import OCCUPIED, UNKNOWN, GridFrame
from foresee.mapping.resampling import resampled
from planner.guide.frontiers import FrontierMap
from planner.guide.route import find_route, nearest_cell
from planner.guide.subgoals import GIVE_UP_COST, expected_costs, with_frontiers
from predictor.data.frontier_samples import (
    CELL,
    COLUMNS,
    GOALS,
    SIDE,
    FrontierSamples,
    frontier_pictures,
    write_frontiers,
)
from predictor.data.packed_samples import SamplesError
from predictor.learned_frontiers import LearnedFrontiers
from predictor.networks.frontier_net import FrontierConfig, FrontierNet
from predictor.recording import exploration
from predictor.recording.exploration import POLICIES, Truth, explore
from predictor.recording.settings import FrontiersConfig
from predictor.registry import PredictorError, load_frontiers
from predictor.train_frontiers import main
from predictor.weights import load_weights
from sim.families import generate
from sim.task import sample_task

START, GOAL = (5.0, 2.0), (5.0, 17.0)

CARD = Path(__file__).parents[2] / "docs/reference/cards/frontiers.md"


def crossing() -> Room:
    """A corridor across the map whose two ends were not observed, and beyond it the goal."""
    room = Room(10.0, 20.0, UNKNOWN)
    room.fill((2.0, 8.0), (1.0, 3.0), 0)
    room.fill((1.5, 8.5), (0.5, 1.0)).fill((1.5, 8.5), (3.0, 3.5))
    return room


class Told:
    """A predictor of frontiers that says which side leads on."""

    def __init__(self, left, right, back=10.0):
        self.sides, self.back, self.asked = (left, right), back, 0

    def values(self, known, goal, frontiers):
        self.asked += 1
        leads = np.array([self.sides[int(f.middle[0] > 5.0)] for f in frontiers])
        return FrontierValues(leads, np.full(len(leads), 16.0), np.full(len(leads), self.back))


def test_the_ends_of_a_corridor_are_its_frontiers():
    found = FrontierMap.of(crossing().cost, START, GOAL)
    assert sorted(f.middle[0] > 5.0 for f in found.frontiers) == [False, True]
    for number, frontier in enumerate(found.frontiers, start=1):
        assert (found.labels == number).sum() == len(frontier.points)
        assert abs(abs(frontier.middle[0] - 5.0) - 3.0) < 0.3
        assert abs(frontier.middle[1] - 2.0) < 0.5
        assert math.dist(frontier.middle, GOAL) < frontier.to_go < math.inf
    assert not (found.reached & (found.labels > 0)).any()


def test_there_are_no_frontiers_to_choose_from_once_the_goal_is_in_sight():
    assert FrontierMap.of(crossing().cost, START, (7.0, 2.0)) is None
    # A car in unobserved space has no surroundings that it could start from.
    assert FrontierMap.of(crossing().cost, (5.0, 10.0), GOAL) is None


@pytest.mark.parametrize("seed", range(3))
def test_expected_costs_are_those_of_the_best_order(seed):
    rng = np.random.default_rng(seed)
    here, between = rng.uniform(1, 20, 4), rng.uniform(1, 20, (4, 4))
    values = FrontierValues(rng.random(4), rng.uniform(5, 50, 4), rng.uniform(0, 20, 4))

    def cost_of(order):
        total, reached = 0.0, 1.0
        for last, one in itertools.pairwise([None, *order]):
            total += reached * (here[one] if last is None else between[last, one])
            total += reached * values.leads[one] * values.way[one]
            reached *= 1.0 - values.leads[one]
            total += reached * values.back[one]
        return total + reached * GIVE_UP_COST

    orders = list(itertools.permutations(range(4)))
    best = [min(cost_of(order) for order in orders if order[0] == first) for first in range(4)]
    assert expected_costs(here, between, values) == pytest.approx(best)


@pytest.mark.parametrize(("left", "right"), [(0.9, 0.1), (0.1, 0.9)])
def test_the_route_leads_by_the_frontier_that_leads_on(left, right):
    room = crossing()
    cost = with_frontiers(room.cost, room.known, START, GOAL, Told(left, right))
    route = find_route(cost, START, GOAL)
    assert (route[:, 0].max() > 8.0) == (right > left)
    assert (route[:, 0].min() < 2.0) == (left > right)


def test_only_the_border_becomes_more_expensive():
    room = crossing()
    plain = room.cost
    cost = with_frontiers(plain, room.known, START, GOAL, Told(0.5, 0.2))
    added = cost.density - plain.density
    assert (added >= 0.0).all()
    assert (added[~plain.unseen] == 0.0).all()
    found = FrontierMap.of(plain, START, GOAL)
    rows, cols = np.nonzero(added)
    assert (found.labels[rows // 2, cols // 2] > 0).all()
    # The best frontier costs no more than before.
    assert len({int(n) for n in found.labels[rows // 2, cols // 2]}) == 1


@pytest.mark.parametrize("values", [np.array([math.nan, 0.5]), np.array([0.5])])
def test_values_that_are_no_numbers_are_refused(values):
    class Broken:
        def values(self, known, goal, frontiers):
            return FrontierValues(values, values, values)

    room = crossing()
    with pytest.raises(ValueError, match=r"values of 2 frontiers|must lie"):
        with_frontiers(room.cost, room.known, START, GOAL, Broken())


def test_a_predictor_of_frontiers_that_fails_does_not_stop_the_car():
    class Failing:
        def values(self, known, goal, frontiers):
            raise SystemError

    task = straight()
    alone, failing = navigator(task), navigator(task)
    failing.guide.search = replace(failing.guide.search, frontiers=Failing())
    before, after = drive(task, alone), drive(task, failing)
    assert after.faults.pop("frontiers_failed") > 0
    assert np.array_equal(before.trace["states"], after.trace["states"])


def test_a_prescribed_route_asks_no_predictor_of_frontiers():
    task, told = straight(), Told(0.5, 0.5)
    driver = navigator(task)
    route = np.array([[2.0, 2.0], [15.0, 2.0]])
    driver.guide.search = replace(driver.guide.search, route=route, frontiers=told)
    drive(task, driver)
    assert told.asked == 0


def test_a_picture_shows_what_was_observed_around_a_frontier():
    room = crossing()
    found = FrontierMap.of(room.cost, START, GOAL)
    pictures, middles = frontier_pictures(room.known.whole(), found.frontiers)
    assert pictures.shape == (len(found.frontiers), 3, SIDE, SIDE)
    known = room.known.whole()
    for picture, middle, frontier in zip(pictures, middles, found.frontiers, strict=True):
        assert np.abs(middle - frontier.middle).max() <= 0.5 * CELL + 1e-9
        assert picture.max() <= 100
        assert 0 < (picture[2] == 100).sum() <= len(frontier.points)
        # All free cells are inside the picture, so their area is that of the map.
        assert picture[0].sum() / 100 * CELL**2 == pytest.approx(known.free.sum() * 0.05**2)


@pytest.mark.parametrize("resolution", [0.025, 0.07, 0.1])
def test_the_resolution_of_a_map_changes_its_predictions_little(resolution):
    room = crossing()
    found = FrontierMap.of(room.cost, START, GOAL)
    other, _, _ = resampled(room.known.whole(), resolution)
    values, others = (
        LearnedFrontiers().values(known, GOAL, found.frontiers)
        for known in (room.known.whole(), other)
    )
    assert others.leads == pytest.approx(values.leads, abs=0.15)


def test_a_point_off_the_map_has_no_cell_near_it():
    wanted, frame = np.ones((20, 20), dtype=bool), GridFrame(0.2, (0.0, 0.0), (20, 20))
    assert nearest_cell(wanted, frame, (1.1, 0.5), 3) == (2, 5)
    for point in ((-3.0, 1.0), (1.0, -3.0), (7.0, 1.0)):
        assert nearest_cell(wanted, frame, point, 3) is None


def test_drives_by_frontiers_are_not_taken_over_from_another_run():
    assert ARMS["known"].drives_alike({"frontiers"})
    assert not ARMS["known+frontiers"].drives_alike(set())


def test_the_truth_tells_which_end_of_a_corridor_leads_to_the_goal():
    true, seen = Room(10.0, 20.0), crossing()
    # A wall across the map, with a passage at its right end; the left side is a dead end.
    true.fill((0.0, 8.5), (7.0, 7.2)).fill((5.0, 5.2), (3.5, 7.0)).fill((5.0, 5.2), (0.0, 0.5))
    true.cells[seen.cells == OCCUPIED] = OCCUPIED
    found = FrontierMap.of(seen.cost, START, GOAL)
    truth = Truth.on(true.world, seen.frame)
    right = [int(f.middle[0] > 5.0) for f in found.frontiers]
    leads, way = (values[np.argsort(right)] for values in truth.ways(found, found.goal))
    assert leads.tolist() == [0.0, 1.0]
    assert 15.0 < way[1] < 25.0
    assert 3.0 < truth.depths(found)[np.argsort(right)][0] < 10.0


@pytest.mark.slow(12)
def test_an_exploration_makes_the_same_samples_again_and_they_are_of_its_building():
    task = sample_task(generate("office", 13), 13, CAR)
    for policy in range(POLICIES):
        once, again = (explore(task, policy, np.random.default_rng(1)) for _ in range(2))
        assert len(once) > 20
        for one, other in zip(once, again, strict=True):
            assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))
        numbers = np.array([sample[1] for sample in once])
        leads, way = (numbers[..., COLUMNS.index(name)] for name in ("leads", "way"))
        assert set(np.unique(leads)) == {0.0, 1.0}
        assert (way[leads == 0] == 0.0).all()
        # A way is at least as long as the straight line, from the nearest cell of the frontier.
        small = np.array([sample[2] for sample in once]) < 6
        straight_line = np.hypot(numbers[..., 0], numbers[..., 1])
        assert (way + 1.0 >= straight_line * leads)[small].all()


def samples(folder, count=3):
    rng = np.random.default_rng(0)
    for number in range(count):
        pictures = rng.integers(0, 101, (5, 3, SIDE, SIDE)).astype(np.uint8)
        numbers = rng.random((5, GOALS, len(COLUMNS))).astype(np.float32)
        about = {"family": "office", "seed": number, "world": f"{number}"}
        write_frontiers(folder / f"{number}.npz", list(pictures), list(numbers), [3.0] * 5, about)
    return pictures, numbers


def test_samples_are_read_as_they_were_written(tmp_path):
    pictures, numbers = samples(tmp_path)
    read = FrontierSamples.load(tmp_path)
    assert len(read) == 15
    assert np.array_equal(read.picture(12), pictures[2])
    assert np.array_equal(read.numbers[10:], numbers)
    assert read.worlds == {"0", "1", "2"}
    assert len(FrontierSamples.load(tmp_path, 1)) == 5


def test_damaged_samples_are_named(tmp_path):
    samples(tmp_path)
    with pytest.raises(SamplesError, match="holds no samples"):
        FrontierSamples.load(tmp_path / "none")
    (tmp_path / "1.npz").write_bytes(b"nonsense")
    with pytest.raises(SamplesError, match=r"1\.npz is damaged"):
        FrontierSamples.load(tmp_path)


def test_the_shape_of_a_network_is_checked():
    with pytest.raises(ValueError, match="positive"):
        FrontierConfig.of({"widths": [16, 0], "hidden": 8})
    assert FrontierConfig.of({"widths": [16], "hidden": 8}) == FrontierConfig((16,), 8)


def test_unusable_predictors_of_frontiers_are_named(tmp_path):
    with pytest.raises(PredictorError, match="'none'"):
        load_frontiers("none")
    with pytest.raises(PredictorError, match="does not exist"):
        load_frontiers(str(tmp_path / "none.safetensors"))


def test_the_card_beside_the_shipped_weights_is_theirs():
    card, facts = CARD.read_text(), LearnedFrontiers().facts
    assert facts["fingerprint"] in card
    (result,) = yaml.safe_load(card.split("---\n")[1])["model-index"][0]["results"]
    for metric in result["metrics"]:
        assert metric["value"] == pytest.approx(facts["validation"][metric["type"]], abs=5e-4)


@pytest.mark.slow(7)
def test_the_shipped_weights_steer_a_drive():
    settings = {"arms": ("known", "known+frontiers"), "vehicle": "reeds-shepp"}
    run = compare("office", seed=13, **settings)
    assert [one.outcome for one in run.episodes] == ["reached", "reached"]
    assert all(one.faults.get("frontiers_failed", 0) == 0 for one in run.episodes)


def test_arms_that_choose_a_route_are_not_driven_on_a_prescribed_one():
    with pytest.raises(UsageError, match="--route free"):
        Settings(route="fixed", arms=("known", "known+frontiers"))


@pytest.mark.slow(8)
def test_a_training_resumes_and_its_weights_predict(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    options = ["--train", "1", "--validation", "1", "--families", "office", "--jobs", "1"]
    assert main([*options, "--steps", "3", "--out", "whole"]) == 0
    assert "of the best constant" in capsys.readouterr().out
    # Buildings that are there are not explored again.
    monkeypatch.setattr(exploration, "explore", None)
    assert main([*options, "--steps", "3", "--out", "whole"]) == 0
    # A folder of another training is refused before anything is explored.
    assert main([*options, "--train", "2", "--steps", "3", "--out", "whole"]) == 2
    assert "train 1" in capsys.readouterr().err
    weights = tmp_path / "whole" / "frontiers.safetensors"
    _, facts = load_weights(weights, FrontierNet)
    assert facts["samples"] == len(FrontierSamples.load(FrontiersConfig().data / "train"))
    room = crossing()
    found = FrontierMap.of(room.cost, START, GOAL)
    values = LearnedFrontiers(weights).values(room.known.whole(), GOAL, found.frontiers)
    assert ((values.leads > 0.0) & (values.leads < 1.0)).all()
    assert (values.back >= 0.0).all()


def test_another_process_is_sent_the_path_of_the_weights_alone():
    ours = LearnedFrontiers()
    sent = pickle.dumps(ours)
    assert len(sent) < 1000
    assert pickle.loads(sent).facts == ours.facts
