"""Steps from the swings of the foot between two stances."""
