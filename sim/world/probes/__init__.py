"""Probe files: read by MuJoCo, checked, and made into one rigid body with its tip and its face."""
