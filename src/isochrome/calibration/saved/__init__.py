"""A calibration on disk: its files, its page, and its values in a scene."""
