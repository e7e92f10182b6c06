"""Sensor error models and their calibration."""
