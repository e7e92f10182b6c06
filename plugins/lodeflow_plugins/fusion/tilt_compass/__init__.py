"""Tilt-compensated compass."""
