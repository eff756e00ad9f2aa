"""A recorded run as files of other tools: tables (CSV, Parquet), ROS 2 messages (MCAP), a recording of Rerun.

From outside: `formats`, which has them by name, and `tables`, the columns of the tables.
"""
