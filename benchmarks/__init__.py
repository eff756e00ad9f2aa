"""Timings against baselines of the same run: `python -m benchmarks.NAME --json`."""

import usvauv.kernels  # noqa: F401  before anything imports taichi itself, whose banner would stand before the JSON
