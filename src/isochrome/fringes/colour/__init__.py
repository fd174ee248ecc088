"""The order of a colour frame."""
