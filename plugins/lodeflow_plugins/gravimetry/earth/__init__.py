"""What moving over a turning ellipsoid adds to the specific force."""
