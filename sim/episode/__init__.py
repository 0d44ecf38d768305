"""Algorithm 1 of the paper: scenario, what all its seeds share, the truth of a seed, the probe's motion, the loop."""
