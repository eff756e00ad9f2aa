"""Motion of the water: storm waves (`airy`), vortices (`vortex`), long waves and real currents on a grid (`current`).

Public: `current.Water`, the arrays of all worlds, and `current.velocity`; `airy.sample`, `vortex.evolution` and the
other functions that take tensors.
"""
