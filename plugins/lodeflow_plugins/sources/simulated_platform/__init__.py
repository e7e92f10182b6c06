"""A rotation platform, a turntable and a table to rest on, to calibrate sensors with."""
