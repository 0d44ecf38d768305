"""The simulation: the world in MuJoCo, and the programs that people run."""
