"""Attitude error of an estimate."""
