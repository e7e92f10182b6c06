"""Linear Kalman filter on the attitude quaternion."""
