"""Colour frames: orders read from rendered frames whose order is known, and honest masks."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pytest

from colour_frames import colour_frames
from isochrome.errors import InputError
from isochrome.fringes import ColourTable, colour_order, measured_table, read_colour, spectral_table
from isochrome.optics import Response, camera_response
from isochrome.scene import Camera, Polariscope, parse_scene
from scene_texts import PAPER_PAIR, beam_text, camera_text, disc_text


def study(*values):
    """A case of a long test whose other cases hold its promise."""
    return pytest.param(*values, marks=pytest.mark.study)


SPECIMENS = {
    "contact": PAPER_PAIR + "[load]\nnormal_n = {load}\n[friction]\ncoefficient = {mu}\n",
    "disc": disc_text("{load}", fringe_value=14.6, thickness_mm=4.0),
    "beam": beam_text("{load}", fringe_value=14.6, thickness_mm=4.0),
}
SPECIMENS["worn"] = (
    SPECIMENS["contact"] + "[wear]\ncoefficient_mm2_per_n = 2e-9\ndistances_m = [77.0]\n"
)
LOAD = {"contact": 44.0, "worn": 44.0, "disc": 320.0, "beam": 200.0}
PLACE = {"contact": (-2.0, 0.0, 4.0), "disc": (-13.5, -0.1, 27.0), "beam": (-13.5, -0.1, 27.0)}
PLACE["worn"] = PLACE["contact"]
OPTICS = '[polariscope]\nwavelength_nm = 587.0\nlight = "white"\nfield = "{field}"\n'
OPTICS += camera_text(
    "{cols}", "{rows}", "{pixel}", left_mm="{left}", top_mm="{top}", bit_depth=8, brightness=0.9,
    background=0.03, vignette=0.3, noise_grey="{noise}", gamma="{gamma}", colour="true",
)  # fmt: skip
FULL, HALF = (494, 659), (247, 330)
WHITE = Polariscope(wavelength_nm=587.0, light="white")


@dataclass(frozen=True)
class Shot:
    """A captured frame with its no-load frames, in grey levels, and its true order."""

    frame: np.ndarray
    dark: np.ndarray
    bright: np.ndarray
    order: np.ndarray
    table: ColourTable
    noise: float
    gamma: float

    def read(self, no_load="both", *, table=None, gamma=None, **given):
        """The reading with both, one or none of the no-load frames."""
        gamma = self.gamma if gamma is None else gamma
        frame, dark, bright = (
            (a.astype(float) / 255.0) ** gamma for a in (self.frame, self.dark, self.bright)
        )
        level = np.maximum(self.frame / 255.0, self.noise / 255.0)
        sigma = gamma * level ** (gamma - 1.0) * max(self.noise, 0.3) / 255.0
        return read_colour(
            frame, table or self.table, sigma=sigma,
            dark=dark if no_load in ("both", "dark") else None,
            bright=bright if no_load in ("both", "bright") else None, valid=self.frame < 255,
            **given,
        )  # fmt: skip


@lru_cache(maxsize=3)
def rendered(kind, *, size=HALF, mu=0.0, noise=3.0, gamma=1.0, field="dark", load=None):
    left, top, width = PLACE[kind]
    rows, cols = size
    pixel = width / cols
    values = {"field": field, "noise": noise, "gamma": gamma, "left": left, "top": top}
    optics = OPTICS.format(rows=rows, cols=cols, pixel=pixel, **values)
    scene = parse_scene(SPECIMENS[kind].format(load=load or LOAD[kind], mu=mu) + optics)
    frames, order = colour_frames(scene, 7)
    table = spectral_table(scene.polariscope, camera_response(scene.camera))
    return Shot(*frames, order, table, noise, gamma)


def errors(reading, order):
    """Errors of the pixels that are said to be known; none of them off the specimen."""
    known = np.isfinite(reading.order)
    assert np.isfinite(order[known]).all()
    return (reading.order - order)[known]


def meets_the_bar(reading, order, *, kept):
    """The bar for colour: RMS 0.02 fringe, wrong branch 0.1 %; and most of N <= 3 is known."""
    error = errors(reading, order)
    assert np.sqrt(np.mean(error**2)) <= 0.02 and np.mean(np.abs(error) > 0.5) <= 1e-3
    assert np.isfinite(reading.order[order <= 3.0]).mean() >= kept


CASES = [("contact", 0.0), ("contact", 0.3), ("worn", 0.25), ("disc", 0.0), ("beam", 0.0)]


@pytest.mark.long
@pytest.mark.parametrize(("kind", "mu"), [study(*CASES[0]), *CASES[1:]])
def test_with_no_load_frames_the_order_is_read(kind, mu):
    shot = rendered(kind, mu=mu)
    reading = shot.read()
    meets_the_bar(reading, shot.order, kept=0.97)
    error = errors(reading, shot.order)
    assert np.sqrt(np.mean(error**2)) <= 0.01  # a single pixel's own noise leaves 0.006
    assert not (np.abs(error) > 0.5).any() and 0.9 < reading.chi < 1.15 and not reading.blind


@pytest.mark.study
@pytest.mark.parametrize(
    ("kind", "mu", "no_load"),
    [
        *((*case, no_load) for case in CASES for no_load in ("both", "none")),
        ("contact", 0.3, "dark"), ("disc", 0.0, "dark"), ("worn", 0.25, "bright"),
        ("beam", 0.0, "bright"),
    ],
)  # fmt: skip
def test_full_frames_meet_the_bar(kind, mu, no_load):
    shot = rendered(kind, mu=mu, size=FULL)
    specimen = np.isfinite(shot.order)
    reading = shot.read(no_load, specimen=specimen)
    meets_the_bar(reading, shot.order, kept=0.97)
    assert np.sqrt(np.mean(errors(reading, shot.order) ** 2)) <= 0.006


@pytest.mark.long
@pytest.mark.parametrize("no_load", [study("dark"), study("bright"), "none"])
@pytest.mark.parametrize("kind", ["contact", study("disc"), "beam"])
def test_without_no_load_frames_the_light_is_found(kind, no_load):
    """Without the bright one, wide black places are left open: they may be no specimen at all."""
    shot = rendered(kind, mu=0.3 if kind == "contact" else 0.0)
    reading = shot.read(no_load)
    known = np.isfinite(reading.order)
    off = known & ~np.isfinite(shot.order)
    assert off.sum() <= 1e-3 * known.sum()
    error = (reading.order - shot.order)[known & ~off]
    assert np.sqrt(np.mean(error**2)) <= 0.02 and np.mean(np.abs(error) > 0.5) <= 1e-3
    assert known[shot.order <= 3.0].mean() >= 0.85 and reading.blind


@pytest.mark.long
@pytest.mark.parametrize("kwargs", [{"gamma": 2.2}, {"field": "bright"}, {"noise": 10.0}])
def test_gamma_bright_field_and_more_noise(kwargs):
    shot = rendered("contact", mu=0.3, **kwargs)
    meets_the_bar(shot.read(), shot.order, kept=0.95)


def test_one_channel_alone_tells_no_order(monkeypatch):
    shot = rendered("contact", mu=0.3)
    over = [np.array(a, dtype=float) for a in (shot.frame, shot.dark, shot.bright)]
    for image in over:
        image[..., 1] *= 1.7
    over[0] = np.clip(over[0], 0.0, 255.0)
    lit = Shot(*over, shot.order, shot.table, shot.noise, 1.0)
    assert (over[0][..., 1] == 255.0).mean() > 0.1
    meets_the_bar(lit.read(), shot.order, kept=0.95)
    over, alone = shot.frame.copy(), np.zeros(HALF, bool)
    alone[60:120, 80:200] = alone[130::7, ::7] = True  # single ones too, whose block knows more
    over[alone, :2] = 255  # red and green are saturated there
    monkeypatch.setattr(colour_order, "BLOCKS", 1)
    got = Shot(over, shot.dark, shot.bright, shot.order, shot.table, shot.noise, 1.0).read()
    assert not np.isfinite(got.order[alone]).any()
    assert np.isfinite(got.order[130:][~alone[130:]]).mean() > 0.95


@pytest.mark.long
def test_confidence_is_the_share_that_is_right():
    """Of the pixels said to be 95 % sure, 95 % are right to 0.05 fringe; so are the less sure."""
    said, right = [], []
    for kind, kwargs in (
        ("contact", {"mu": 0.3, "noise": 20.0}),
        ("contact", {"load": 300.0, "mu": 0.3}),
        ("disc", {"load": 700.0}),
    ):
        shot = rendered(kind, **kwargs)
        reading = shot.read()
        known = np.isfinite(reading.order)
        assert (reading.confidence[~known] == 0.0).all()
        said.append(reading.confidence[known])
        right.append(np.abs(errors(reading, shot.order)) < 0.05)
    said, right = np.concatenate(said), np.concatenate(right)
    assert right[said >= 0.95].mean() >= 0.95
    unsure = said < 0.98
    assert unsure.sum() > 1000  # else the next line says nothing
    # neighbours share their noise: some thousand pixels are some hundred trials
    assert right[unsure].mean() >= said[unsure].mean() - 0.05


@pytest.mark.long
def test_stated_uncertainty_is_that_of_the_errors():
    for no_load in ("both", "none"):
        shot = rendered("contact", mu=0.3)
        reading = shot.read(no_load)
        known = np.isfinite(reading.order)
        pull = errors(reading, shot.order) / reading.uncertainty[known]
        assert 0.6 < np.sqrt(np.mean(pull**2)) < 1.4


def test_orders_beyond_the_colours_are_masked_not_guessed():
    """A disc up to N = 30 and more beside its loads: white of any order is no order."""
    shot = rendered("disc", load=900.0)
    assert np.nanmax(shot.order) > 30.0
    reading = shot.read()
    error = errors(reading, shot.order)
    assert np.mean(np.abs(error) > 0.5) <= 1e-3 and np.nanmax(reading.order) < 7.0
    assert np.isfinite(reading.order[shot.order <= 3.0]).mean() >= 0.8


def gaussian_response(peaks, widths):
    places = np.arange(400.0, 701.0, 2.0)
    peaks, widths = np.array(peaks)[:, None], np.array(widths)[:, None]
    return Response(
        ("red", "green", "blue"), places, np.exp(-0.5 * ((places - peaks) / widths) ** 2)
    )


@pytest.mark.long
@pytest.mark.parametrize("no_load", [study("both"), "none"])
@pytest.mark.parametrize("kind", ["contact", study("beam")])
@pytest.mark.parametrize(
    ("peaks", "widths"), [((620, 560, 440), (35, 33, 30)), ((600, 540, 460), (50, 50, 50))]
)
def test_a_wrong_table_shows_in_chi_and_nothing_is_read(kind, peaks, widths, no_load):
    shot = rendered(kind)
    reading = shot.read(no_load, table=spectral_table(WHITE, gaussian_response(peaks, widths)))
    assert reading.chi > 1.5 and reading.strange > 0.03
    assert not np.isfinite(reading.order).any() and reading.kept == 0.0
    assert (reading.confidence == 0.0).all()


def test_a_wrong_gamma_shows_and_nothing_is_read():
    reading = rendered("contact", mu=0.3, gamma=2.2).read(gamma=1.0)
    assert reading.chi > 1.5 and not np.isfinite(reading.order).any()
    shot = rendered("contact")
    idle = Shot(shot.dark, shot.dark, shot.bright, 0.0 * shot.order, shot.table, 3.0, 1.0)
    reading = idle.read()
    assert np.nanmax(reading.order) < 0.06  # sqrt of the noise of N², sin² being flat there
    with pytest.raises(InputError, match=r"no fringes|not the table's"):
        Shot(
            np.full_like(shot.dark, 8), shot.dark, shot.bright, shot.order, shot.table, 3.0, 1.0
        ).read("none")


@pytest.mark.long
def test_light_too_uneven_to_be_found_needs_the_no_load_frames():
    """A lamp off the middle whose corners have a fifth of its light: no quadratic surface."""
    shot = rendered("contact", mu=0.3)
    y, x = (np.linspace(-1.0, 1.0, n) for n in HALF)
    lamp = np.exp(-((x[None, :] - 0.4) ** 2 + (y[:, None] + 0.3) ** 2) / 1.9)[..., None]
    images = [np.rint(a * lamp) for a in (shot.frame, shot.dark, shot.bright)]
    uneven = Shot(*images, shot.order, shot.table, shot.noise, 1.0)
    meets_the_bar(uneven.read(), shot.order, kept=0.95)
    blind = uneven.read("none")
    assert blind.lost and blind.kept == 0.0
    assert not np.isfinite(blind.order).any() and not blind.confidence.any()


def test_a_table_is_the_integral_over_the_spectrum_and_ends_where_all_is_white():
    """Against a plain sum over a fine grid of wavelengths."""
    table = spectral_table(WHITE, camera_response(Camera(colour=True)))
    wave = np.linspace(400.0, 700.0, 30001)
    sensor = np.exp(
        -0.5 * ((wave - np.array([[600.0], [540.0], [460.0]])) / [[35.0], [33.0], [30.0]]) ** 2
    )
    ends = np.ones(len(wave))
    ends[[0, -1]] = 0.5
    for order in (0.0, 0.5, 1.75, 3.0, 5.25):
        light = np.sin(np.pi * order * 587.0 / wave) ** 2
        exact = (sensor * light * ends).sum(axis=1) / (sensor * ends).sum(axis=1)
        # the trapezoid's own error on 1e-2 nm is 1e-8
        np.testing.assert_allclose(table.signal[int(order * 256)], exact, rtol=0, atol=1e-6)
    white = spectral_table(WHITE, camera_response(Camera(colour=True)))
    assert 5.0 < white.highest < 10.0 and white.white == pytest.approx([0.5] * 3, abs=0.01)
    assert white.highest_of(0.2) < white.highest_of(0.05) < white.highest
    lines = Polariscope(
        wavelength_nm=587.0, lines={"wavelength_nm": (460.0, 540.0, 600.0), "power": (1, 1, 1)}
    )
    endless = spectral_table(lines, gaussian_response((600, 540, 460), (5, 5, 5)))
    assert endless.highest == 12.0 and endless.white is None
    scope = Polariscope(wavelength_nm=587.0, light="white", plate_wavelength_nm=560.0)
    assert (spectral_table(scope, camera_response(Camera(colour=True))).spread > 0.002).all()


def test_a_table_is_not_measured_where_orders_are_missing():
    order = np.linspace(0.0, 3.0, 400)[None].repeat(20, axis=0)
    light = np.sin(np.pi * order[..., None] * [1.0, 1.1, 1.3]) ** 2
    gap = np.where((order > 1.0) & (order < 1.5), np.nan, order)
    with pytest.raises(InputError, match="none near N = 1"):
        measured_table(light, gap)
    with pytest.raises(InputError, match="from N = 0 on"):
        measured_table(light, np.where(order < 0.5, np.nan, order))


def test_no_load_frames_without_a_contrast_between_them_are_refused():
    shot = rendered("contact")
    light = shot.frame / 255.0
    with pytest.raises(InputError, match="no contrast between its dark and bright ends"):
        read_colour(light, shot.table, sigma=0.01, dark=light, bright=0.0 * light)
