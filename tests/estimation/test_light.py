"""The light's images span what they are to: frames are written as sums of them exactly."""

import numpy as np
import pytest

from isochrome.estimation import (
    LIGHT_FALLS,
    PixelLight,
    Pixels,
    Unevenness,
    frame_light,
    light_sizes,
    prepare,
    solve_linear,
    total_degree,
)

SHAPE = (40, 60)
Y, X = (np.linspace(-1.0, 1.0, n) for n in SHAPE)
Y = Y[:, None]
RNG = np.random.default_rng(4)
DARK = 0.1 + 0.01 * RNG.random(SHAPE)
BRIGHT = 0.8 + 0.1 * RNG.random(SHAPE)
SIGNAL = RNG.random(SHAPE)
PLANE = 1.0 + 0.1 * X - 0.2 * Y


@pytest.mark.parametrize(
    ("dark", "bright", "image"),
    [
        (DARK, BRIGHT, PLANE * (BRIGHT - DARK) * SIGNAL + 0.9 * DARK + 0.02),
        (None, BRIGHT, PLANE * BRIGHT * SIGNAL + 0.05 * PLANE),
        (DARK, None, (PLANE - 0.3 * X * X) * SIGNAL + DARK + 0.02),
        (None, None, (PLANE - 0.3 * X * Y) * SIGNAL + 0.02),
    ],
)
def test_a_frames_light_is_a_sum_of_the_models_images(dark, bright, image):
    model = frame_light(SHAPE, dark, bright)
    problem = prepare(image, mask=None, sigma=1.0, light=model)
    found = solve_linear(problem, SIGNAL.ravel())
    # single precision: images of order one are known to some 1e-7, over the square root of nothing
    assert np.sqrt(found.cost / problem.size) < 1e-6
    assert found.positive
    assert len(found.coefficients) == model.unknowns


def test_one_amplitude_is_the_even_part_alone():
    plain = frame_light(SHAPE).plain()
    assert np.array_equal(plain.illumination(np.array([0.5])), np.full(SHAPE, 0.5))


RICH = total_degree(5)[:-2], total_degree(3)


@pytest.mark.parametrize("ends", [(None, None), (DARK, BRIGHT), (None, BRIGHT), (DARK, None)])
@pytest.mark.parametrize(("terms", "stride"), [(None, 1), (RICH, 1), (RICH, 2)])
def test_light_by_its_moments_is_least_squares_of_its_images(ends, terms, stride):
    """Beside `numpy.linalg.lstsq` of images that are written out, at some of the pixels."""
    dark, bright = ends
    model = frame_light(SHAPE, dark, bright, terms=terms)
    keep = (RNG.random(SHAPE) < 0.6)[::stride, ::stride]
    keep[:3] = keep[:, 7:9] = False
    signal, weight, image, row = (
        RNG.random(SHAPE)[::stride, ::stride][keep] + 0.1 for _ in range(4)
    )

    def images(degrees):
        unit = np.eye(6)
        return [
            np.polynomial.legendre.legval2d(*np.broadcast_arrays(Y, X), np.outer(unit[i], unit[j]))
            for i, j in degrees
        ]

    shade = 1.0 if bright is None else bright if dark is None else bright - dark
    below = ([] if dark is None else [dark]) + images(model.terms[1])
    columns = np.array(
        [
            (shade * part)[::stride, ::stride][keep] * weight * signal
            for part in images(model.terms[0])
        ]
        + [part[::stride, ::stride][keep] * weight for part in below]
    ).T
    problem = Pixels(image, weight, PixelLight(model.every(stride), keep))
    part = solve_linear(problem, signal)
    best, *_ = np.linalg.lstsq(columns, image * weight)
    # images and sums of rows are in single precision, and the light's inverse amplifies by 100
    assert part.residual == pytest.approx(image * weight - columns @ best, abs=1e-5)
    rows = np.array([row, image])
    part.project(rows)
    best, *_ = np.linalg.lstsq(columns, np.array([row, image]).T)
    assert rows == pytest.approx(np.array([row, image]) - (columns @ best).T, abs=1e-5)


@pytest.mark.parametrize("ends", [(None, None), (DARK, BRIGHT), (DARK, None)])
def test_uneven_light_is_least_squares_with_its_prior_as_data(ends):
    """Beside `numpy.linalg.lstsq` of the images with a row over its standard deviation for each
    product besides the first ones; the derivatives are of what the same smoother leaves."""
    uneven = Unevenness(0.5, LIGHT_FALLS[0], (4, 2))
    model = frame_light(SHAPE, *ends, uneven=uneven)
    problem = prepare(PLANE * SIGNAL + 0.1 * X**3, mask=None, sigma=0.01, light=model)
    lit, dark = problem.columns
    columns = np.concatenate((lit * SIGNAL.ravel(), dark)).T
    sizes = 0.5 * np.array(light_sizes(model.terms, LIGHT_FALLS[0]))
    if ends[1] is not None:
        sizes[: len(lit)] /= (BRIGHT - DARK).mean()
    if ends[0] is not None:
        sizes = np.insert(sizes, len(lit), np.inf)
    first = np.zeros(len(sizes), bool)
    first[: len(model.first[0])] = first[len(lit) : len(lit) + 1 + (ends[0] is not None)] = True
    known = np.diag(1.0 / sizes)[~first]
    every, nought = np.concatenate((columns, known)), np.zeros(len(known))
    best, *_ = np.linalg.lstsq(every, np.r_[problem.data, nought])
    part = solve_linear(problem, SIGNAL.ravel())
    # images are in single precision, of data of a hundred noises
    assert part.residual == pytest.approx(problem.data - columns @ best, abs=1e-3)
    assert part.known == pytest.approx(np.sum(np.square(known @ best)), rel=1e-3)
    hat = columns @ np.linalg.pinv(every)[:, : problem.size]
    assert part.count == round(np.trace(hat))
    assert part.chi == pytest.approx(np.sqrt(part.known / (part.count - first.sum())))
    rows = problem.data[None].copy()
    part.project(rows)
    assert rows[0] == pytest.approx(part.residual, abs=1e-3)
