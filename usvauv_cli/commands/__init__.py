"""The commands of `usvauv`, as a rule one a file, and the options they share (`options`).

A command imports what it needs when it runs, so that `--help` answers at once.
"""
