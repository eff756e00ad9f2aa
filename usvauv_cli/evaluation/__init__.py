"""Implementation of `usvauv eval`: combinations that advance together in batches, and their results so far.

`comparison.Comparison` has means, intervals and paired differences, `tables` prints them as tables and sentences;
`run.batches` runs missing episodes, and `run.definition` lists everything that decides the results.
"""
