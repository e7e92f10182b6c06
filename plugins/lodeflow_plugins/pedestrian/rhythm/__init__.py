"""Steps from the rhythm of a signal."""
