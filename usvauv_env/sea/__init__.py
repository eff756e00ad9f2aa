"""The sea of a scenario, drawn from a seed: long waves by a shallow-water solver, and a storm of short waves upon them.

`build` draws and makes both, `long_waves` has what a world needs of the solver, `storm` the spectra. For a sea without
vehicles there are `simulation.SeaSimulation` and its record as CF-NetCDF, `netcdf.SeaFile`; `usvauv.cli.sea_view`
draws it.
"""
