"""Benchmarks: programs that measure speed and quality; `.venv/bin/python -m benchmarks.<name>` runs one."""
