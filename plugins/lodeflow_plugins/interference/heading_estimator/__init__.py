"""Heading from two compasses and a rate gyro, with disturbances as correlated noise."""
