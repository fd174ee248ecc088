from .render import SEED, render_samples, samples_path
from .shipped import (
    CalibrationSample,
    ContactSample,
    bending,
    disc,
    line_contact_wear,
    sliding_film,
)

__all__ = [
    "SEED",
    "CalibrationSample",
    "ContactSample",
    "bending",
    "disc",
    "line_contact_wear",
    "render_samples",
    "samples_path",
    "sliding_film",
]
