"""The simulation: the world in MuJoCo, episodes in it, what they leave behind, and the commands that people run."""
