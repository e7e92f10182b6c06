"""A simulated vehicle with an IMU and a magnetometer."""
