"""Steps from the time in which the foot does not move."""
