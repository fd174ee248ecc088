"""One frame: its model, its unknowns and their fit."""
