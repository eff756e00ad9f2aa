"""What `usvauv eval` does: combinations that advance together by batches, and what is known of them so far.

`comparison.Comparison` has means, intervals and paired differences, `tables` says them in tables and sentences;
`run.batches` runs what is missing, and `run.definition` says what decides the results.
"""
