"""Implementation of `usvauv eval`: combinations that advance together in batches, and their results so far.

`comparison.Comparison` has means, intervals and paired differences, `comparison_tables` prints them as tables and
sentences, `ranking` says which combination is best; `batches.batches` runs missing episodes, and `batches.definition`
lists everything that decides the results.
"""
