"""Reachability: studies of a workspace, search for a base, comparison of arms, and one pose explained."""
