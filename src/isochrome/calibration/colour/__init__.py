"""A colour table from the lab's own images."""
