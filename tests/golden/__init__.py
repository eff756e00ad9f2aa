"""The golden trace, which `python -m tests.golden` compares and writes."""
