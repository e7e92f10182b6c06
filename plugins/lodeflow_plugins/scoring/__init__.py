"""Scores of estimates against the truth."""
