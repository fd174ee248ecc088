"""What one frame says of its scene: values, how sure they are, and of what else that depends."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from isochrome.estimation import Minimum
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.inputs import StatedInputs
from isochrome.scene import Scene


@dataclass(frozen=True, kw_only=True)
class FrameFit:
    """What one frame says of its scene.

    Parameters
    ----------
    scene : Scene
        The scene with the fitted values.
    keys : tuple of str, (p,)
        The unknowns that were fitted.
    values : ndarray, (p,)
        Their values, in the units that the keys name.
    standard_uncertainty : ndarray, (p,)
        Their standard uncertainties, inf for what the frame does not tell: of the noise and of all
        inputs whose uncertainty is stated.
    covariance : ndarray, (p, p)
        Their covariance, of the same.
    noise_uncertainty : ndarray, (p,)
        Their standard uncertainties by the frame's noise alone.
    inputs : StatedInputs
        What was known beforehand (m,): unknowns with a prior first, then what was held.
    sensitivity : ndarray, (p, m)
        Change of the values over that of each input's stated value.
    cramer_rao_bound : ndarray, (p,)
        The least standard uncertainties that noise like this frame's allows.
    information : ndarray, (p, p)
        The Fisher information of the frame's pixels, from which the bound follows.
    freedom : int
        Pixels less unknowns.
    chi : float
        Residual over noise.
    others : tuple of Minimum
        Other minima, by rising chi.
    converged : bool
        Whether the steps came to an end.
    plain : bool
        True where a free illumination came out negative and one amplitude for all the frame had to
        do. The model is poor then.
    positive : bool
        False where even that is negative. The scene's fringes are not in the frame then, nor any
        light that follows them by more than noise does by chance.
    noise_ratio : float, default 1.0
        The noise over what the frame's finest part shows, which compression takes away.
    """

    scene: Scene
    keys: tuple[str, ...]
    values: Array
    standard_uncertainty: Array
    covariance: Array
    noise_uncertainty: Array
    inputs: StatedInputs
    sensitivity: Array
    cramer_rao_bound: Array
    information: Array
    freedom: int
    chi: float
    others: tuple[Minimum, ...]
    converged: bool
    plain: bool
    positive: bool
    noise_ratio: float = 1.0

    def less_sure(self, more: Array) -> FrameFit:
        """The same with a covariance that is larger by `more` (p, p), as if by noise."""
        variance = np.diag(more)
        return replace(
            self,
            covariance=self.covariance + more,
            standard_uncertainty=np.sqrt(self.standard_uncertainty**2 + variance),
            noise_uncertainty=np.sqrt(self.noise_uncertainty**2 + variance),
        )
