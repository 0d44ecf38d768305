"""Campaigns: studies, the trials of which they consist, the journal of the trials that are done, and its tables."""
