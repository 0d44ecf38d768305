"""The commands for probes and sensors that are not simulated here."""
