"""Inverse kinematics: from sensing poses to joint positions, one by one or many at once, or the reason why not."""
