from .shipped import (
    SEED,
    CalibrationSample,
    ContactSample,
    bending,
    disc,
    line_contact_wear,
    render_samples,
    samples_path,
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
