"""Attitude from gyroscope, accelerometer and magnetometer, both stages in one."""
