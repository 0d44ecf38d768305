"""How the probe gets to the poses of an episode: it jumps, follows a path, or is driven by servos."""
