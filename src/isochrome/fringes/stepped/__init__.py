"""Order and isoclinic angle from a phase-stepped set."""
