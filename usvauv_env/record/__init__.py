"""What happened in a run: the trace, and what is made of a trace and nothing else (metrics, tables, error bound).

`recorder.record` runs a policy and gives a `trace.Trace`; videos and figures are drawn from it in `usvauv_env.render`
and `usvauv_cli`.
"""
