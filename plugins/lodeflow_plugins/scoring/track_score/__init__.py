"""Distance of a track from the true one."""
