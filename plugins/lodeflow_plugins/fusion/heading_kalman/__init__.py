"""Heading Kalman filter on top of an attitude whose heading drifts."""
