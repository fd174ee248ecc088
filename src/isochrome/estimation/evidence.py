"""When a model describes an image, and when more unknowns are worth having."""

from __future__ import annotations

import numpy as np

POOR_CHI = 1.3
"""Residual over noise beyond which the model does not describe a frame within its noise.

The noise is estimated from the frame itself, to some 3 to 11 % of its standard deviation
(`isochrome.frames.noise`), and chi of a right model is off from 1 by as much. Three times that is
no accident of the estimate."""

ALIKE_CHI = 1.05
"""Ratio of two minima's chi below which an image does not decide between them: a fraction of what
the noise's own estimate is off by, and what a small misfit of either model makes."""

RIVAL_CHI = 1.3
"""Ratio of two minima's chi below which a finer model may yet turn their order round: the search's
own model, or its fewer unknowns of light, do not decide between them."""


LITTLE, HALF = 0.9, 0.5
"""Shares of chi² - 1 that are left: by what explains little, and by what does not explain much.

The first is not kept, the second not gone on with: a hundred products of light take up some of
anything."""


def is_explained(before: float, after: float, left: float) -> bool:
    """Whether chi² - 1, of residual over noise, fell below a share `left` of what it was."""
    return after**2 - 1.0 < left * (before**2 - 1.0)


def stays_poor(before: float, after: float, left: float) -> bool:
    """Whether more unknowns leave chi above `POOR_CHI`, and a share `left` of chi² - 1 at least."""
    return after > POOR_CHI and not is_explained(before, after, left)


def evidence_gain(old: tuple[float, int], new: tuple[float, int], *, pixels: int) -> float:
    """What Bayes' information criterion gains by another model; it is the better one above 0.

    n (c_old - c_new) / min(c_old, c_new) - (k_new - k_old) ln n: the fall of chi-square in units of
    the better fit's, less ln n for each unknown more. A fit is its mean squared residual c, in any
    one unit, and its number of unknowns k. Source: Schwarz (1978), Ann. Statist. 6, 461-464.
    """
    best = max(min(old[0], new[0]), 1e-24)
    return float(pixels * (old[0] - new[0]) / best - (new[1] - old[1]) * np.log(pixels))
