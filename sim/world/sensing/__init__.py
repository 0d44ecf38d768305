"""Sensing: what turns a contact of the probe into a reading."""
