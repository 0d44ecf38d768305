"""Algorithm 1 of the paper: the scenario, the setup its seeds share, the truth of a seed, the motion, the loop."""
