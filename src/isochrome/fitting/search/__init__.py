"""Starts for a frame whose scene is far off."""
