"""Shallow-water solvers: `linear` (forward–backward on a C grid, CPU and GPU backends), `nonlinear` (finite volumes).

From outside use `linear.ShallowWater`, `nonlinear.NonlinearShallowWater`, `boundaries` (kinds) and `discretisation`
(layout of fields).
"""
