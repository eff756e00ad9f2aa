"""The commands of `usvauv`, usually one per file, and their common options (`options`).

A command imports what it needs when it runs, so that `--help` answers at once.
"""
