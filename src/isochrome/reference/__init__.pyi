from .bending import beam_moment, beam_stress
from .brazilian_disc import disc_centre_difference, disc_principal_difference, disc_stress
from .cauchy import StressField
from .hertz import (
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
from .hole import hole_stress
from .punch import (
    punch_pressure,
    punch_stress,
    wavy_full_contact_pressure,
    wavy_half_width,
    wavy_pressure,
    wedge_half_width,
    wedge_pressure,
)
from .ring_plate import ring_stress
from .sliding import (
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
    "ring_stress",
    "sliding_hertz_stress",
    "wavy_full_contact_pressure",
    "wavy_half_width",
    "wavy_pressure",
    "wedge_half_width",
    "wedge_pressure",
]
