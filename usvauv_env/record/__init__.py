"""Records of runs: the trace, and metrics and tables computed from a trace alone.

`recorder.record` runs a policy and returns a `trace.Trace`; `evaluation.run_episodes` runs policies on the same worlds.
Videos and figures are drawn from a trace in `usvauv.env.render` and `usvauv_cli`.
"""
