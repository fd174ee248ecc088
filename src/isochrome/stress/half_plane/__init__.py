"""Stress in a half-plane under surface tractions."""
