"""The camera's scale and lens from a picture of a target, or of two edges."""
