"""Guidance: courses, headings in a current and speeds, in kernels and with tensors, and kernels that act by them.

`elementary` has operations and `equation`, by which a function serves kernels and torch; `courses` and `passing` have
the equations; `acting` acts on a CPU by heuristics and learned policies, whose networks `network` computes.
"""
