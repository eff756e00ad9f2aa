"""The place of a scenario: bathymetry, real current, speed of sound, read from CF-NetCDF files and tables.

Other packages use `site.Site`; `cf_ocean` and `local_frame` are also for scripts that inspect a file's water.
"""
