"""What is kept on the disk and in memory: files written whole, one process at a time, tables that grow, bounded memory.

`files` writes and locks, `text_files` reads TOML and JSON, `netcdf` NetCDF, `tables` has CSV files, `memory` refuses
what does not fit.
"""
