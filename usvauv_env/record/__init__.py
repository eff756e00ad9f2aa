"""What happened in a run: the trace, and what is made of a trace and nothing else (metrics, tables).

`recorder.record` runs a policy and gives a `trace.Trace`; `evaluation.evaluate` runs policies on the same worlds.
Videos and figures are drawn from a trace in `usvauv.env.render` and `usvauv_cli`.
"""
