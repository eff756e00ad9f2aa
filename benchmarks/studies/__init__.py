"""Experiments whose figures and tables stand in `docs/`: `python -m benchmarks.studies.NAME --help`."""
