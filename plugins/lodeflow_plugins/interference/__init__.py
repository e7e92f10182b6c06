"""Magnetic interference: recognising it, and a heading that lives with it."""
