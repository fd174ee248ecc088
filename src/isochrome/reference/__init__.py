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
| ring, diametral loads | `ring_stress` |
| four-point bending | `beam_moment`, `beam_stress` |
| plate with a round hole, tension | `hole_stress` |

Units N, mm, MPa; tension positive; x to the right, z downward (into the block from its surface,
in a disc or ring and beside a hole from its centre). Fields come as `StressComponents`. Loads,
moduli, pressures and sizes are above zero, coordinates finite; for others, and for what a parameter
says is not allowed, `isochrome.errors.InputError` names the argument.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
