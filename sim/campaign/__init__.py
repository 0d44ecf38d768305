"""Campaigns: studies, the trials that they are made of, the journal of what is done, and its tables."""
