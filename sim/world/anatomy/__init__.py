"""Anatomy: organ, tumours and structures, from a patient's files, from a generator or planted by seed, put in place."""
