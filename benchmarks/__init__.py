"""Measured speed and quality of the map; run one with `python -m benchmarks.<name>`."""
