"""Sounding-Bench: frozen tasks, the run of a planner on all of them, its submission, and the check of one.

Each task is a campaign; nothing here runs an episode by itself.
"""
