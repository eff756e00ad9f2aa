"""The place of a scenario: bathymetry, real current, speed of sound, read from CF-NetCDF files and tables.

`site.Site` is what other rooms use; `cf_ocean` and `local_frame` also serve scripts that look at a file's water.
"""
