"""The kinds of `lodeflow calibrate` that come with lodeflow, and their figures."""
