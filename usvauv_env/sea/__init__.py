"""The sea of a scenario, drawn from a seed: long waves by a shallow-water solver, and a storm of short waves upon them.

`build` makes both, `long_waves` says what a world needs of the solver; `forcing` and `storm` hold the statistics.
"""
