"""The sea of a scenario without vehicles: its simulation and its record as CF-NetCDF.

`simulation.SeaSimulation` and `netcdf.SeaFile` are what `usvauv sea` uses; its video and figure are in
`usvauv.cli.sea_view`.
"""
