"""Several frames that share unknowns."""
