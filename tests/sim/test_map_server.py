import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from sim.map_server import MODES, MapError, MapFile, load_world, occupancy, save_world
from sim.world import World

YAML = """\
image: map.pgm
resolution: 0.1
origin: [-1.5, 2.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""


def random_world(seed: int, resolution: float = 0.05) -> World:
    rng = np.random.default_rng(seed)
    shape = (int(rng.integers(1, 40)), int(rng.integers(1, 40)))
    cells = rng.choice(np.array([FREE, OCCUPIED, UNKNOWN], np.int8), shape)
    return World("random", Grid(GridFrame(resolution, (-3.25, 1.1), shape), cells))


def put(folder: Path, pixels: np.ndarray, text: str = YAML, name: str = "map.pgm") -> Path:
    Image.fromarray(pixels).save(folder / name)
    (folder / "map.yaml").write_text(text.replace("map.pgm", name))
    return folder / "map.yaml"


@pytest.mark.parametrize("resolution", [0.05, 0.1, 1 / 3])
def test_a_world_comes_back_as_it_was_saved(tmp_path, resolution):
    for seed in range(5):
        world = random_world(seed, resolution)
        save_world(world, tmp_path / "back.yaml")
        back = load_world(tmp_path / "back.yaml")
        assert np.array_equal(back.grid.cells, world.grid.cells)
        assert back.grid.frame == world.grid.frame
        assert back.name == "back"
    assert set(os.listdir(tmp_path)) == {"back.yaml", "back.pgm"}


@pytest.mark.parametrize("mode", MODES)
def test_a_world_is_read_in_each_mode(tmp_path, mode):
    for seed in range(5):
        cells = random_world(seed).grid.cells
        shades = {"trinary": (254, 0, 205), "scale": (255, 0, 128), "raw": (0, 100, 255)}[mode]
        pixels = np.choose((cells == OCCUPIED) + 2 * (cells == UNKNOWN), shades).astype(np.uint8)
        if mode == "scale":
            alpha = np.where(cells == UNKNOWN, 0, 255).astype(np.uint8)
            pixels = np.stack([pixels, alpha], axis=-1)
        name = "map.png" if mode == "scale" else "map.pgm"
        path = put(tmp_path, pixels[::-1], YAML + f"mode: {mode}\n", name)
        assert np.array_equal(load_world(path).grid.cells, cells)


def test_the_bottom_row_of_the_image_is_the_lowest_y(tmp_path):
    pixels = np.array([[0, 254], [254, 254], [205, 205]], np.uint8)
    cells = load_world(put(tmp_path, pixels)).grid.cells
    assert cells.tolist() == [[UNKNOWN, UNKNOWN], [FREE, FREE], [OCCUPIED, FREE]]


def test_thresholds_are_inclusive_as_in_map_server(tmp_path):
    text = YAML.replace("0.65", "0.8").replace("0.196", "0.2")
    pixels = np.array([[50, 51, 52, 203, 204, 205]], np.uint8)
    cells = load_world(put(tmp_path, pixels, text)).grid.cells
    assert cells.tolist() == [[OCCUPIED, OCCUPIED, UNKNOWN, UNKNOWN, FREE, FREE]]


def test_the_unknown_of_a_map_saver_stays_unknown_at_its_thresholds(tmp_path):
    text = YAML.replace("0.196", "0.25")
    for free in (254, 255):
        pixels = np.array([[0, 205, free]], np.uint8)
        for image in (pixels, np.stack([pixels] * 3, axis=2)):
            cells = load_world(put(tmp_path, image, text, "map.png")).grid.cells
            assert cells.tolist() == [[OCCUPIED, UNKNOWN, FREE]]
    # A grey image with other shades has no shade for unknown space.
    pixels = np.array([[0, 205, 230, 254]], np.uint8)
    cells = load_world(put(tmp_path, pixels, text)).grid.cells
    assert cells.tolist() == [[OCCUPIED, FREE, FREE, FREE]]


def test_negating_the_image_and_the_flag_changes_nothing(tmp_path):
    pixels = np.arange(256, dtype=np.uint8).reshape(8, 32)
    for mode in ("trinary", "scale"):
        text = YAML + f"mode: {mode}\n"
        plain = load_world(put(tmp_path, pixels, text)).grid.cells
        negated = put(tmp_path, 255 - pixels, text.replace("negate: 0", "negate: 1"))
        assert np.array_equal(load_world(negated).grid.cells, plain)


def test_an_ascii_pgm_says_the_same_as_a_binary_one(tmp_path):
    pixels = np.array([[0, 254, 205], [254, 0, 254]], np.uint8)
    binary = load_world(put(tmp_path, pixels)).grid.cells
    (tmp_path / "map.pgm").write_text("P2\n# made by hand\n3 2\n255\n0 254 205\n254 0 254\n")
    assert np.array_equal(load_world(tmp_path / "map.yaml").grid.cells, binary)


@pytest.mark.parametrize("mode", ["1", "L", "LA", "P", "RGB", "RGBA", "I;16"])
def test_every_kind_of_png_says_the_same(tmp_path, mode):
    grey = np.array([[0, 255, 255], [255, 0, 255]], np.uint8)
    if mode == "I;16":
        image = Image.fromarray(grey.astype(np.uint16) * 257)
    else:
        image = Image.fromarray(grey).convert(mode)
    image.save(tmp_path / "map.png")
    (tmp_path / "map.yaml").write_text(YAML.replace("map.pgm", "map.png"))
    cells = load_world(tmp_path / "map.yaml").grid.cells
    assert np.array_equal(cells, np.where(grey[::-1] == 255, FREE, OCCUPIED))


def test_scale_mode_keeps_the_order_of_shades_and_reads_alpha(tmp_path):
    meta = MapFile(tmp_path, 0.05, (0, 0), mode="scale")
    ramp = np.arange(256, dtype=np.uint8).reshape(1, 256, 1)
    data = occupancy(ramp, meta)[0].astype(int)
    assert np.all(np.diff(data) <= 0)
    assert data[0] == 100
    assert data[255] == 0
    assert len(np.unique(data)) == 101
    half = np.concatenate([ramp, np.full_like(ramp, 254)], axis=2)
    assert np.all(occupancy(half, meta) == UNKNOWN)


@pytest.mark.parametrize("mode", ["trinary", "scale"])
def test_alpha_changes_no_shade_and_a_pixel_that_is_not_opaque_is_unknown(tmp_path, mode):
    meta = MapFile(tmp_path, 0.05, (0, 0), mode=mode)
    shades = np.arange(0, 256, 5, dtype=np.uint8).reshape(1, -1, 1)
    plain = occupancy(shades, meta)
    for channels in (1, 3):
        colours = np.repeat(shades, channels, axis=2)
        for alpha, expected in ((255, plain), (254, UNKNOWN), (0, UNKNOWN)):
            pixels = np.concatenate([colours, np.full_like(shades, alpha)], axis=2)
            assert np.all(occupancy(pixels, meta) == expected)


def test_raw_mode_takes_values_as_they_are_and_worlds_cut_them_at_the_thresholds(tmp_path):
    meta = MapFile(tmp_path, 0.05, (0, 0), mode="raw")
    ramp = np.arange(256, dtype=np.uint8).reshape(1, 256, 1)
    data = occupancy(ramp, meta)[0]
    assert data[:101].tolist() == list(range(101))
    assert np.all(data[101:] == UNKNOWN)
    path = put(tmp_path, np.array([[0, 20, 21, 64, 65, 100, 255]], np.uint8), YAML + "mode: raw\n")
    assert load_world(path).grid.cells.tolist() == [
        [FREE, FREE, UNKNOWN, UNKNOWN, OCCUPIED, OCCUPIED, UNKNOWN]
    ]


def test_numbers_in_scientific_notation_are_numbers(tmp_path):
    path = put(tmp_path, np.zeros((2, 2), np.uint8), YAML.replace("0.1\n", "5e-2\n"))
    assert load_world(path).grid.frame.resolution == 0.05


GOOD = {
    "mode": ["mode: Trinary", "mode: TRINARY", "mode:", 'mode: "trinary"'],
    "negate: 0": ['negate: "0"', "negate: false", 'negate: "no"', "negate: 0.0"],
    "[-1.5, 2.0, 0.0]": ["[-1.5, 2.0, 1e-9]", "[-1.5, 2.0, -6.283185307179586]", '["-1.5", 2, 0]'],
    "0.1\n": ['"0.1"\n', "1.0e-1\n"],
}


@pytest.mark.parametrize(("usual", "odd"), [(u, o) for u, odds in GOOD.items() for o in odds])
def test_what_map_server_accepts_is_read_as_the_same_map(tmp_path, usual, odd):
    pixels = np.array([[0, 254, 205], [254, 0, 254]], np.uint8)
    usually = load_world(put(tmp_path, pixels)).grid
    text = f"{YAML}{odd}\n" if usual == "mode" else YAML.replace(usual, odd)
    grid = load_world(put(tmp_path, pixels, text)).grid
    assert np.array_equal(grid.cells, usually.cells)
    assert grid.frame == usually.frame


def test_a_tiff_of_32_bits_is_refused_and_one_that_counts_from_white_is_turned(tmp_path):
    grey = np.array([[0, 254, 254]], np.uint8)
    path = put(tmp_path, grey.astype(np.int32) * 2**23, name="map.tiff")
    with pytest.raises(MapError, match="32-bit numbers: save it with 8 or 16"):
        load_world(path)
    for photometric in (0, 1):
        deep = grey.astype(np.uint16) * 257
        stored = 65535 - deep if photometric == 0 else deep
        Image.fromarray(stored).save(tmp_path / "map.tiff", tiffinfo={262: photometric})
        assert load_world(path).grid.cells.tolist() == [[OCCUPIED, FREE, FREE]]


BROKEN = {
    "resolution: 0.1": ["resolution: 0", "resolution: -1", "resolution: .nan", "resolution: wide"],
    "origin: [-1.5, 2.0, 0.0]": ["origin: [0, 0, 0.3]", "origin: 3", "origin: [0, .inf, 0]"],
    "negate: 0": [
        "negate: 2",
        'negate: "2"',
        "negate: [0]",
        "",
        "negate: 0\nmode: fancy",
        "negate: 0\nmode: [raw]",
    ],
    "free_thresh: 0.196": ["free_thresh: 0.9", "free_thresh: -0.1", "free_thresh: yes"],
    "occupied_thresh: 0.65": ["occupied_thresh: 1.5"],
    "image: map.pgm": ["image: gone.pgm", "image: [map.pgm]", "image: .", "", "image: map.yaml"],
    YAML: ["", "a: [", "- 1", "\x00\x01", "[" * 3000, "\udcff", "x: !!python/object:os.system {}"],
}


@pytest.mark.parametrize(("good", "bad"), [(g, b) for g, bads in BROKEN.items() for b in bads])
def test_a_broken_map_gives_one_line_that_names_the_file(tmp_path, good, bad):
    path = put(tmp_path, np.zeros((2, 2), np.uint8))
    path.write_bytes(YAML.replace(good, bad).encode(errors="surrogateescape"))
    with pytest.raises(MapError) as caught:
        load_world(path)
    assert "\n" not in str(caught.value)
    assert str(tmp_path) in str(caught.value)


def test_a_missing_file_a_folder_and_a_cut_image_give_one_line(tmp_path):
    for path in (tmp_path / "none.yaml", tmp_path):
        with pytest.raises(MapError, match="cannot be read"):
            load_world(path)
    path = put(tmp_path, np.zeros((50, 50), np.uint8), name="map.png")
    whole = (tmp_path / "map.png").read_bytes()
    for length in (0, 7, 40, len(whole) // 2):
        (tmp_path / "map.png").write_bytes(whole[:length])
        with pytest.raises(MapError, match="not a usable image") as caught:
            load_world(path)
        assert "\n" not in str(caught.value)


def test_an_absurdly_large_image_is_refused_before_it_is_decoded(tmp_path):
    path = put(tmp_path, np.zeros((2, 2), np.uint8))
    (tmp_path / "map.pgm").write_bytes(b"P5\n9000 9000\n255\n" + b"\0" * 10)
    with pytest.raises(MapError, match="the limit is"):
        load_world(path)
    (tmp_path / "map.pgm").write_bytes(b"P5\n900000 900000\n255\n" + b"\0" * 10)
    with pytest.raises(MapError, match="not a usable image"):
        load_world(path)


def test_saving_refuses_what_it_cannot_do(tmp_path):
    world = random_world(0)
    with pytest.raises(MapError, match="written"):
        save_world(world, tmp_path / "no" / "a.yaml")
    with pytest.raises(MapError, match=r"\.yaml"):
        save_world(world, tmp_path / "a")
    assert os.listdir(tmp_path) == []
