"""A scenario's sea, drawn from a seed: long waves from a shallow-water solver, and a storm of short waves on them.

`long_waves` forces and starts the solver, `storm` has the spectra, `water` combines both and the real current on one
clock for worlds. For a sea without vehicles there are `simulation.SeaSimulation` and its record as CF-NetCDF,
`sea_file.SeaFile`; `usvauv.cli.sea_view` draws it.
"""
