"""The commands of `usvauv`, one file each, and the options they share (`options`).

A command imports what it needs when it runs, so that `--help` answers at once.
"""
