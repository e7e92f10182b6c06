"""Attitude from gyroscope and accelerometer, with the gyroscope's bias."""
