"""The mission of many worlds as Taichi functions: tasks, boat strategies, target rules, fixes, rewards, observations.

`run.run` is the kernel, `worlds.Worlds` has the arrays that its functions pass on.
"""
