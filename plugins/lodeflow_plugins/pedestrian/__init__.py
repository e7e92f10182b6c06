"""Steps of a walker with an inertial sensor on the foot, and the track that they make."""
