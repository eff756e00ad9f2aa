"""Motion of the water as Taichi functions: storm waves, vortices, long waves, real currents on a grid, and their sum.

From outside: `current.Water`, the arrays of all worlds, and `current.velocity`; `airy.sample`, `vortex.evolution` and
the other functions that take tensors.
"""
