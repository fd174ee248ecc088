"""Closed forms with their sources: truth for the tests, and useful by themselves.

| of | closed forms |
|---|---|
| a pair of bodies | `contact_modulus`, `coupling_modulus_inverse`, `dundurs_beta` |
| Hertz line contact | `hertz_half_width`, `hertz_peak_pressure`, `hertz_pressure`, `hertz_stress` \
(McEwen), `hertz_largest_difference` |
| sliding, no coupling | `sliding_hertz_stress` |
| sliding, coupled | `coupled_contact`, `coupled_pressure`, `coupled_stress` |
| flat punch | `punch_pressure`, `punch_stress` |
| blunt wedge | `wedge_half_width`, `wedge_pressure` |
| wavy surface | `wavy_full_contact_pressure`, `wavy_half_width`, `wavy_pressure` |
| disc, diametral loads | `disc_stress`, `disc_principal_difference`, `disc_centre_difference` |
| four-point bending | `beam_moment`, `beam_stress` |
| plate with a round hole, tension | `hole_stress` |

Units N, mm, MPa; tension positive; x to the right, z downward (into the block from its surface,
in a disc and beside a hole from its centre). Fields come as `StressField`. Bad arguments raise
`isochrome.errors.InputError`.
"""

from __future__ import annotations

from isochrome.reference._common import StressField
from isochrome.reference.beam import beam_moment, beam_stress
from isochrome.reference.disc import (
    disc_centre_difference,
    disc_principal_difference,
    disc_stress,
)
from isochrome.reference.hertz import (
    LargestDifference,
    contact_modulus,
    coupling_modulus_inverse,
    dundurs_beta,
    hertz_half_width,
    hertz_largest_difference,
    hertz_peak_pressure,
    hertz_pressure,
    hertz_stress,
)
from isochrome.reference.hole import hole_stress
from isochrome.reference.punch import (
    punch_pressure,
    punch_stress,
    wavy_full_contact_pressure,
    wavy_half_width,
    wavy_pressure,
    wedge_half_width,
    wedge_pressure,
)
from isochrome.reference.sliding import (
    CoupledContact,
    coupled_contact,
    coupled_pressure,
    coupled_stress,
    sliding_hertz_stress,
)

__all__ = [
    "CoupledContact",
    "LargestDifference",
    "StressField",
    "beam_moment",
    "beam_stress",
    "contact_modulus",
    "coupled_contact",
    "coupled_pressure",
    "coupled_stress",
    "coupling_modulus_inverse",
    "disc_centre_difference",
    "disc_principal_difference",
    "disc_stress",
    "dundurs_beta",
    "hertz_half_width",
    "hertz_largest_difference",
    "hertz_peak_pressure",
    "hertz_pressure",
    "hertz_stress",
    "hole_stress",
    "punch_pressure",
    "punch_stress",
    "sliding_hertz_stress",
    "wavy_full_contact_pressure",
    "wavy_half_width",
    "wavy_pressure",
    "wedge_half_width",
    "wedge_pressure",
]
