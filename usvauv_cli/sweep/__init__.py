"""Studies of many runs: the file that names them, a folder for each run, their results and what they say.

`results.sweep` is the entrance; where the runs are done is an engine of `usvauv.cli.engines`.
"""
