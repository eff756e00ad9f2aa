"""Shallow-water solvers: `linear` (forward–backward on a C grid, CPU and GPU backends), `nonlinear` (finite volumes).

Public: `linear.ShallowWater`, `nonlinear.NonlinearShallowWater`, `discretisation` (boundaries and layout of fields).
"""
