from .shipped import (
    CalibrationSample,
    ContactSample,
    bending,
    disc,
    line_contact_wear,
    samples_path,
    sliding_film,
)

__all__ = [
    "CalibrationSample",
    "ContactSample",
    "bending",
    "disc",
    "line_contact_wear",
    "samples_path",
    "sliding_film",
]
