"""Readers that err: what they get wrong, by lesion and by view, and how often, as options and as published figures."""
