"""The sea of a scenario, drawn from a seed: long waves by a shallow-water solver, and a storm of short waves upon them.

`long_waves` forces and starts the solver, `storm` has the spectra, `water` is both with the real current on one clock,
as worlds sail on it. For a sea without vehicles there are `simulation.SeaSimulation` and its record as CF-NetCDF,
`netcdf.SeaFile`; `usvauv.cli.sea_view` draws it.
"""
