"""What the cases share: the paper's numbers, interleaved timing, and ratios."""

import time
from dataclasses import replace

import numpy as np

from isochrome.reference import (
    contact_modulus,
    coupling_modulus_inverse,
    hertz_half_width,
    hertz_peak_pressure,
)

OURS, PAPER = "this project", "the paper's procedure"

PAIR = (2100.0, 0.4, 210000.0, 0.3)
MODULUS, COUPLING = contact_modulus(*PAIR), coupling_modulus_inverse(*PAIR)
RADIUS, LOAD, FRICTION, WEAR = 24.61, 11.0, 0.25, 2e-9
HALF_WIDTH = hertz_half_width(LOAD, RADIUS, MODULUS)
PEAK = hertz_peak_pressure(LOAD, RADIUS, MODULUS)

_LONG_S = 2.0
"""A call that has had this much time in all is not repeated."""
_SHORT_S = 0.02
"""A call shorter than this is timed in groups that are about as long."""
_SAME_ERROR = 1.01
"""Errors of rivals that differ by less than this are one."""


def timed(calls, *, repeats=5):
    """Results and median seconds of calls that take turns, so that a slow machine slows all; a
    first, untimed run warms up, and is the only one where it was long."""
    results, first = [], []
    for call in calls:
        start = time.perf_counter()
        results.append(call())
        first.append(time.perf_counter() - start)
    groups = [max(1, int(_SHORT_S / max(t, 1e-6))) for t in first]
    times = [[] for _ in calls]
    for _ in range(repeats):
        for call, group, seen, t in zip(calls, groups, times, first, strict=True):
            if t + sum(seen) < _LONG_S:
                start = time.perf_counter()
                for _ in range(group):
                    call()
                seen.append((time.perf_counter() - start) / group)
    return results, [float(np.median(s or [t])) for s, t in zip(times, first, strict=True)]


def with_ratios(rows):
    """Our rows of one case with the ratio to a rival's fastest setting at the same or smaller
    error; where none gets there, to the most accurate one, and the row says so."""
    done = []
    for row in rows:
        rivals = [r for r in rows if r.method != OURS and r.case == row.case and r.error == r.error]
        if row.method != OURS or not rivals:
            done.append(row)
            continue
        there = [r for r in rivals if r.error <= row.error]
        best = _SAME_ERROR * min(r.error for r in rivals)
        rival = min(there or [r for r in rivals if r.error <= best], key=lambda r: r.seconds)
        done.append(replace(row, ratio=rival.seconds / row.seconds, reached=bool(there)))
    return done


def plain(ratio):
    """A ratio to two figures, never as a power of ten."""
    return f"{ratio:.2g}" if ratio < 10.0 else f"{float(f'{ratio:.2g}'):.0f}"


PAPER_CONTACT = """\
[specimen]
young_gpa = 2.1
poisson = 0.4
thickness_mm = 4.0
fringe_value_n_per_mm = 14.6
[indenter]
radius_mm = 24.61
young_gpa = 210.0
poisson = 0.3
[load]
normal_n = 44.0
"""
"""The paper's block, cylinder and load."""
