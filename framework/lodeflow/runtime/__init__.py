"""A graph in execution: one rule for event time, two drivers (blocks, single samples)."""
