"""Timings against baselines of the same run: `python -m benchmarks.NAME --json`."""
