"""Steps from the peaks of a signal."""
