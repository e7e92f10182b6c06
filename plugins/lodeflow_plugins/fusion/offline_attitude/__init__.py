"""Attitude of a recording, from what came before and after."""
