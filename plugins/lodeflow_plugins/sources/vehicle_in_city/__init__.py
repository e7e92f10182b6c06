"""A vehicle with two compasses and a rate gyro that drives through magnetic disturbances."""
