"""Attitude and heading from several sensors."""
