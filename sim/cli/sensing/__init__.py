"""Commands about what a sensor makes of a contact."""
