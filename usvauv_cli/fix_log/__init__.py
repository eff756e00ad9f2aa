"""Logs of fixes that a real USBL system made: reading them, and where the AUVs are by them.

From outside: `estimate.auvs_of_log`.
"""
