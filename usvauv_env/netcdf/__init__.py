"""Reading NetCDF files from anywhere: a process of its own reads, so that a damaged file can neither hang nor crash us.

`reader.open_file` and `reader.values`, decoded and with xarray, and `remote.open_remote` are what other rooms use.
"""
