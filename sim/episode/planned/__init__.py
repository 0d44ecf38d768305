"""What of an episode is known before it begins and needs no MuJoCo: the organ in place, and what is planned on it."""
