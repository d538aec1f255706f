"""The paper's image of a map and of a belief."""

import numpy as np

from foresee.mapping.grid import Grid, GridFrame
from foresee.prediction import Prediction
from predictor.scoring.images import ternary

N = 60
FRAME = GridFrame(0.05, (0.0, 0.0), (N, N))
UNSEEN = Grid(FRAME, np.full((N, N), -1, np.int8))


def believed(p_free, p_occupied=None) -> Prediction:
    p_free = np.asarray(p_free, np.float32)
    p_occupied = np.zeros_like(p_free) if p_occupied is None else p_occupied
    return Prediction(FRAME, p_free, p_occupied, np.ones_like(p_free))


def test_the_image_of_a_map_is_the_papers():
    known = Grid(GridFrame(0.05, (0.0, 0.0), (1, 3)), np.array([[0, 100, -1]], np.int8))
    assert ternary(known, None).tolist() == [[1.0, 0.0, 0.5]]


def test_what_was_seen_stays_as_it_is():
    rng = np.random.default_rng(0)
    known = Grid(FRAME, rng.choice(np.array([0, 100, -1], np.int8), (N, N)))
    p_free = rng.uniform(0.0, 1.0, (N, N)).astype(np.float32)
    image = ternary(known, believed(p_free, 1.0 - p_free))
    assert (image[known.free] == 1.0).all()
    assert (image[known.occupied] == 0.0).all()


def test_halves_that_are_believed_are_drawn():
    p_free = np.full((N, N), 0.1)
    p_free[:, : N // 2] = 0.9
    p_occupied = np.zeros((N, N), np.float32)
    p_occupied[:, N // 2] = 0.8
    image = ternary(UNSEEN, believed(p_free, p_occupied))
    assert (image[:, : N // 2] == 1.0).all()
    assert (image[:, N // 2] == 0.0).all()
    assert (image[:, N // 2 + 1 :] == 0.5).all()


def test_specks_are_not():
    p_free = np.full((N, N), 0.9)
    p_free[20, 20] = 0.4
    p_free[40:42, 30] = 0.2
    assert (ternary(UNSEEN, believed(p_free)) == 1.0).all()


def test_nor_are_specks_of_free_space():
    p_free = np.full((N, N), 0.1)
    p_free[20, 20] = 0.6
    p_free[40:42, 30] = 0.8
    assert (ternary(UNSEEN, believed(p_free)) == 0.5).all()


def test_what_is_certainly_not_free_is_not_made_so():
    p_free = np.full((N, N), 0.9)
    p_free[20, 20] = 0.0
    image = ternary(UNSEEN, believed(p_free))
    assert image[20, 20] == 0.5
    assert (image == 1.0).sum() == N * N - 1


def test_nothing_comes_of_no_belief():
    known = Grid(FRAME, np.zeros((N, N), np.int8))
    known.cells[30, 30] = -1
    image = ternary(known, believed(np.zeros((N, N))))
    assert image[30, 30] == 0.5
    assert (image == 1.0).sum() == N * N - 1
