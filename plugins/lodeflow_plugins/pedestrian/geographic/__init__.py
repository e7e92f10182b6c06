"""From the body frame into the geographic frame."""
