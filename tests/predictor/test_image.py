"""Maps as images: what is known stays where it is, and nothing is lost."""

import numpy as np
import pytest
from generated_frames import generated
from hypothesis import given
from hypothesis import strategies as st

from predictor.data.squares import GREYS
from predictor.networks.grey_image import map_images, nearest_pixels, pixels_at_cells
from predictor.networks.image_config import EXPANSIONS, ImageConfig
from predictor.training.image_validation import batch_images


def some_codes(n, seed=0):
    return np.random.default_rng(seed).integers(0, 3, (n, n)).astype(np.uint8)


def test_free_is_white_and_occupied_black():
    assert GREYS.tolist() == [1, -1, 0]


@given(st.integers(1, 256), st.integers(0, 100))
def test_an_image_that_is_no_smaller_gives_the_map_back(n, seed):
    codes = some_codes(n, seed)
    assert np.array_equal(pixels_at_cells(map_images(codes, 256), n), GREYS[codes])


@given(st.integers(65, 200), st.integers(0, 100))
def test_in_a_smaller_image_no_wall_is_lost_and_nothing_turns_free(n, seed):
    codes = some_codes(n, seed)
    back = pixels_at_cells(map_images(codes, 64), n)
    assert (back <= GREYS[codes]).all()


@given(st.integers(65, 200))
def test_in_a_smaller_image_every_pixel_is_of_some_cell(n):
    assert np.array_equal(np.unique(nearest_pixels(n, 64)), np.arange(64))
    uniform = np.zeros((n, n), np.uint8)
    assert (map_images(uniform, 64) == 1).all()


@pytest.mark.parametrize("side", [64, 128, 256])
def test_images_are_mirrored_as_maps_are(side):
    codes = some_codes(130)
    if side >= 130:
        assert np.array_equal(map_images(codes[:, ::-1], side), map_images(codes, side)[:, ::-1])
    assert np.array_equal(map_images(codes.T, side), map_images(codes, side).T)


def test_several_maps_at_once():
    codes = np.stack([some_codes(110, seed) for seed in range(3)])
    together = map_images(codes, 128)
    assert all(
        np.array_equal(map_images(one, 128), image)
        for one, image in zip(codes, together, strict=True)
    )


@pytest.mark.parametrize("expansion", EXPANSIONS)
@pytest.mark.parametrize("side", [128, 256])
def test_what_is_given_and_what_is_asked_for_lie_on_each_other(expansion, side):
    frames = generated(3, 0)
    squares = [frames.square(index, expansion) for index in range(3)]
    given_, wanted = batch_images(squares, ImageConfig(expansion=expansion, side=side))
    assert given_.shape == wanted.shape == (3, 1, side, side)
    if side == 256:
        # What was seen is true.
        assert (given_ == wanted)[given_ != 0].all()
    n = round(100 * expansion)
    inset = (n - 100) // 2
    crop = pixels_at_cells(given_[:, 0], n)[:, inset : n - inset, inset : n - inset]
    if side >= n:
        assert np.array_equal(crop, GREYS[frames.estimated])
        assert np.array_equal(
            pixels_at_cells(wanted[:, 0], n), GREYS[frames.truth(np.arange(3), expansion)]
        )


def test_of_the_crop_nothing_beyond_it_is_given_and_of_the_window_all_that_was_seen():
    frames = generated(3, 0)
    crop, window = (
        batch_images([frames.square(0, 2.0)], ImageConfig(expansion=2.0, given=name))[0]
        for name in ("crop", "window")
    )
    crop, window = (pixels_at_cells(images[0, 0], 200) for images in (crop, window))
    ring = np.ones((200, 200), dtype=bool)
    ring[50:150, 50:150] = False
    assert (crop[ring] == 0).all()
    assert (window[ring] != 0).any()
    assert np.array_equal(window, GREYS[frames.remembered[0]])
