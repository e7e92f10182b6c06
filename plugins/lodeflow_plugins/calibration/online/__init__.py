"""Hard iron of a magnetometer, estimated while running."""
