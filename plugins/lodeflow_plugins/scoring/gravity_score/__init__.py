"""Difference of two streams of corrections."""
