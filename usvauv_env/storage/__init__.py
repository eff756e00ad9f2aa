"""What is kept on the disk and in memory: files written whole, one process at a time, tables that grow, bounded memory.

`files` writes, locks, and reads TOML and JSON, `netcdf` reads NetCDF, `tables` has CSV files, `memory` refuses what
does not fit.
"""
