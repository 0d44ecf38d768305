"""Reachability: studies of a workspace, the search for a base, comparisons of arms, and explanations of a pose."""
