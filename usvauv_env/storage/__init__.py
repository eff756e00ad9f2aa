"""Storage on the disk and in memory: files written whole, by one process at a time, growing tables, bounded memory.

`files` writes, locks, and reads TOML and JSON, `netcdf` reads NetCDF, `result_tables` has CSV files, `memory` refuses
requests that do not fit.
"""
