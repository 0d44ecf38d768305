"""Closed triangle surfaces as solids: which points lie inside, how far it is to the surface, where rays cross it."""
