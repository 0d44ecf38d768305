"""Paths over the surface: the roadmap of poses between which the probe glides, and the planners of paths on it."""
