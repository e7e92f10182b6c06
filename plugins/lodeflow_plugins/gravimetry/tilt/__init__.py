"""What the tilt of a platform takes from the vertical specific force."""
