"""A track from steps and attitude."""
