from .contact import surface_field_grid
from .interface import SpecimenModel, specimen_model

__all__ = ["SpecimenModel", "specimen_model", "surface_field_grid"]
