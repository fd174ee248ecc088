"""A frame is saturated where it has a plateau, at full scale or below it, and not by a level."""

import numpy as np
import pytest

from isochrome.frames import saturation_level, to_linear
from isochrome.processing import process_frame
from isochrome.scene import parse_scene

ROW, COL = np.mgrid[:240, :320].astype(float)
ORDER = 0.5 + 2.4 * np.hypot((ROW - 100.0) / 240.0, (COL - 170.0) / 320.0)
SIGNAL = np.sin(np.pi * ORDER) ** 2


def stored(crest, *, noise=0.0, clip=255.0, depth=8, seed=3):
    """Grey levels of fringes from 10 % to `crest`, clipped, and the light that is lost there."""
    rng = np.random.default_rng(seed)
    grey = 0.1 * crest + 0.9 * crest * SIGNAL + noise * rng.standard_normal(SIGNAL.shape)
    levels = np.clip(np.rint(grey), 0, clip).astype(np.uint8 if depth == 8 else np.uint16)
    return levels, grey > clip + 0.5


@pytest.mark.parametrize(("crest", "noise"), [(255.0, 0.0), (243.0, 3.0), (240.0, 3.0)])
def test_a_frame_that_reaches_the_top_level_by_chance_is_not_saturated(crest, noise):
    levels, _ = stored(crest, noise=noise)
    top = levels + np.uint8(255 - levels.max())  # its brightest pixel is 255
    assert top.max() == 255 and saturation_level(top, full=255.0) == np.inf
    assert to_linear(top, bit_depth=8).valid.mean() > 0.9999


@pytest.mark.parametrize("noise", [0.0, 1.0, 3.0])
@pytest.mark.parametrize("over", [8.0, 30.0, 200.0])
def test_a_frame_that_is_clipped_at_full_scale_loses_the_clipped_pixels(over, noise):
    levels, lost = stored(255.0 + over, noise=noise)
    assert saturation_level(levels, full=255.0) == 255.0
    valid = to_linear(levels, bit_depth=8).valid
    assert not valid[lost].any()
    assert valid[levels < 255].mean() > 0.99  # some look dead, among clipped ones


@pytest.mark.parametrize(
    ("clip", "depth", "full"),
    [(240.0, 8, 255.0), (200.0, 8, 255.0), (4095.0, 16, 65535.0), (3900.0, 16, 4095.0)],
)
def test_a_plateau_below_the_types_end_is_saturation_too(clip, depth, full):
    """A camera that clips at 240 of 255; 12 bits in a file of 16; 12 bits that end early."""
    scale = clip / 240.0
    levels, lost = stored(1.1 * clip, noise=2.0 * scale, clip=clip, depth=depth)
    assert saturation_level(levels, full=full) == clip and lost.mean() > 0.05
    assert not to_linear(levels, bit_depth=8 if depth == 8 else 16).valid[lost].any()


def test_only_a_plateau_on_top_is_saturation():
    levels, lost = stored(265.0, noise=2.0, clip=240.0)
    levels[::60, ::70] = 255
    levels[5:10, 5:10] = 255
    for kind, full, depth in ((levels, 255.0, 8), ((levels / 255.0).astype(np.float32), 1.0, None)):
        assert saturation_level(kind, full=full) == pytest.approx(240.0 * full / 255.0)
        assert not to_linear(kind, bit_depth=depth).valid[lost].any()
    # A bright field far from the contact: one level over half of the picture, without noise
    levels = np.rint(230.0 * np.cos(np.pi * np.exp(-((ROW / 60.0) ** 2))) ** 2).astype(np.uint8)
    assert np.mean(levels == levels.max()) > 0.2 and saturation_level(levels, full=255.0) == np.inf


@pytest.mark.parametrize("gamma", [0.7, 1.0, 2.2])
def test_noise_alone_is_not_saturation(gamma):
    """An even frame, a tone curve, any seed: the top of a histogram that thins out."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        grey = 255.0 * (0.7 + 0.02 * rng.standard_normal((200, 200))) ** (1.0 / gamma)
        levels = np.clip(np.rint(grey), 0, 255).astype(np.uint8)
        assert levels.max() < 255 and saturation_level(levels, full=255.0) == np.inf


@pytest.mark.parametrize("noise", [0.3, 0.6])
def test_a_dark_no_load_frame_of_few_levels_is_not_saturated(noise):
    """Four levels of dark light that fades to the corners, and their noise: no plateau on top."""
    light = 7.0 - ((ROW - 120.0) / 240.0) ** 2 - ((COL - 144.0) / 240.0) ** 2
    for seed in range(12):
        rng = np.random.default_rng(seed)
        levels = np.rint(light + rng.uniform() + noise * rng.standard_normal(ROW.shape))
        valid = to_linear(levels.astype(np.uint8), bit_depth=8, allow_blank=True).valid
        assert valid.mean() > 0.999


def test_fractions_are_told_alike():
    levels, lost = stored(280.0, noise=3.0)
    light = (levels / 255.0).astype(np.float32)
    assert saturation_level(light, full=1.0) == 1.0
    assert not to_linear(light, bit_depth=None).valid[lost].any()
    rng = np.random.default_rng(1)
    open_end = np.minimum(0.1 + 0.7 * SIGNAL + 0.01 * rng.standard_normal(SIGNAL.shape), 0.75)
    assert saturation_level(open_end.astype(np.float32), full=1.0) == pytest.approx(0.75)


TEXT = """
[specimen]
[camera]
bit_depth = 8
[[frames.known_order]]
row_px = 100
col_px = 230
order = ORDER
"""


@pytest.mark.long
@pytest.mark.parametrize(
    ("crest", "clip", "read"), [(255.0, 255.0, True), (300.0, 255.0, False), (270.0, 240.0, False)]
)
def test_orders_are_read_of_a_full_frame_and_not_of_a_clipped_one(crest, clip, read):
    """Over 3 % at the top level are no reason; a plateau at any level is."""
    levels, _ = stored(crest, noise=0.0 if read else 2.0, clip=clip)
    assert np.mean(levels >= clip) > 0.03
    scene = parse_scene(TEXT.replace("ORDER", f"{ORDER[100, 230]}"))
    found = process_frame(levels, scene, 0).frame
    assert any("saturated" in text for text in found.warnings) is not read
    assert (found.reading is not None) is read
