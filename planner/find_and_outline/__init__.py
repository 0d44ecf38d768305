"""The planner find-and-outline: a search for balls that may still hide, weighed against outlining what was found.

Besides the planner itself, the search lattice, the balls, the frontier of what was found, and the shortest tour."""
