"""Sensing along the way: the ground that a probe glides over, its timed ways in contact, and the readings on them."""
