"""Filters of signals that several families use."""
