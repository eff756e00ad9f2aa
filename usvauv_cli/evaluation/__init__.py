"""What `usvauv eval` does: combinations that advance together by batches, and what is known of them so far.

`comparison.Comparison` has means, intervals and paired differences, `batches.run` runs, `definition.definition` says
what decides the results.
"""
