"""Frames captured by others, where they lie beside the repository."""

import numpy as np

from isochrome.frames import look_through, open_frames
from isochrome.scene import parse_scene
from real_frames import REAL, needs_real

pytestmark = needs_real


def test_a_ring_is_read_in_order_of_load_and_checked_in_plain_words():
    with open_frames(REAL / "ring-five-loads", wavelength_nm=546) as reader:
        frames = list(reader)
    assert reader.names == ("0.bmp", "100.bmp", "200.bmp", "300.bmp", "400.bmp")
    assert reader.shape == (224, 224) and reader.channel == "green"
    # The first is the unloaded specimen in the dark field: by far the darkest.
    means = [f.image.mean() for f in frames]
    assert means[0] < 0.5 * min(means[1:])
    checked = look_through(REAL / "ring-five-loads", parse_scene('[specimen]\nshape = "ring"\n'))
    assert checked.ok and checked.count == 5
    assert any("a ring has no model without specimen.hole_mm" in f.text for f in checked.findings)


def test_disc_photograph_is_read_in_the_channel_of_its_light():
    with open_frames(REAL / "disc-seven-loads" / "DSC_0008.jpg", wavelength_nm=546) as reader:
        (frame,) = reader
    assert frame.image.shape == (2000, 2992) and frame.image.dtype == np.uint8
    assert reader.channel == "green"
