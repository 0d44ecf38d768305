"""The planner find-and-outline: a search for balls that may still hide, weighed against outlining what was found.

Beside the planner itself there are the refined search lattice, the balls, the frontier of what was found, and the
shortest tour.
"""
