"""Frames of a formula's order without a camera, cos 2 pi N and noise, and what is read of them."""

import numpy as np
import pytest

from isochrome import fringes
from isochrome.fringes import KnownOrders, KnownPlaces

SHAPE = (160, 220)
ROWS, COLS = np.indices(SHAPE)
SLOPE = 0.3 + COLS / 100.0 + ROWS / 800.0
"""Orders 0.3 to 2.7, all fringes open: mirrored about 1.5 or 2 they are as good."""


def seeds(count, quick):
    """The seeds of a study, of which the first are read in each long run."""
    return [n if n < quick else pytest.param(n, marks=pytest.mark.study) for n in range(count)]


def light(order, noise, valid=True):
    """cos 2 pi N under noise, the noise, and what is trusted; NaN = no specimen."""
    body = np.isfinite(order) & valid
    wave = np.cos(2.0 * np.pi * np.where(body, order, 0.0))
    wave += noise * np.random.default_rng(2).normal(size=order.shape)
    return np.where(body, wave, 0.0), np.full(order.shape, noise), body


def read_free(wave, sigma, valid, known, lines=(), corners=()):
    """A reading in light that is known, with points (row, col, order), or with an extremum."""
    points = [
        KnownPlaces(((row, col),), order, extremum=turn[0] if turn else None)
        for row, col, order, *turn in known
    ]
    orders = KnownOrders((*points, *lines), tuple(corners))
    return fringes.read_free(wave, sigma, valid, orders, error=np.zeros(wave.shape))


def read(order, known=(), lines=(), corners=(), *, noise=0.05, valid=True):
    """A reading of an order (rows, cols) with what is known of it."""
    return read_free(*light(order, noise, valid), known, lines, corners)


def kept(got, order):
    """Share of the specimen that is known, and the largest error of that."""
    known = np.isfinite(got.reading.order)
    error = np.abs(got.reading.order - order)[known]
    return known.sum() / np.isfinite(order).sum(), error.max(initial=0.0)


def assert_kept(got, order, share=0.9, worst=0.1):
    """Most is known, and what is known is right."""
    known, error = kept(got, order)
    assert known > share and error < worst
