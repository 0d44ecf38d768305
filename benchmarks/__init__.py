"""Benchmarks: programs that measure speed and quality; `python -m benchmarks.<name>` runs one."""
