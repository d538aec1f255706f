"""SSIM of an image in all ways of `Similarity`."""

import numpy as np
import pytest

from predictor.scoring.images import BLOCKS, beyond_crop, similarity


def test_an_image_is_wholly_like_itself_and_less_like_any_other():
    rng = np.random.default_rng(0)
    truth = rng.choice([0.0, 0.5, 1.0], size=(130, 130))
    unseen = rng.random(truth.shape) < 0.3
    same = similarity(truth, truth, truth, unseen)
    assert all(value == pytest.approx(1.0) for value in vars(same).values())
    blank = np.full_like(truth, 0.5)
    other = similarity(blank, np.where(unseen, blank, truth), truth, unseen)
    assert all(value < 0.9 for value in vars(other).values())
    assert other.ssim < other.ssim_kept


def test_far_off_a_shift_by_a_cell_costs_less_at_a_coarser_resolution():
    truth = np.ones((200, 200))
    truth[:, ::16] = truth[:, 1::16] = 0.0
    far = beyond_crop(200) > BLOCKS[-1][0]
    moved = np.roll(truth, 1, axis=1)
    shifted = similarity(moved, moved, truth, far)
    assert shifted.ssim_coarse_unseen > shifted.ssim_unseen
    near = beyond_crop(200) < 0
    of_near = similarity(moved, moved, truth, near)
    assert of_near.ssim_coarse_unseen == pytest.approx(of_near.ssim_unseen)


def test_without_an_unseen_cell_there_is_nothing_to_say_of_them():
    truth = np.ones((110, 110))
    nothing = similarity(truth, truth, truth, np.zeros(truth.shape, bool))
    assert np.isnan(nothing.ssim_unseen)
    assert nothing.ssim == pytest.approx(1.0)
