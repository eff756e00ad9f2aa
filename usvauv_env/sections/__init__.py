"""The sections of a scenario: every number, with its range, unit and meaning.

All values are SI: metres, seconds, radians, watts, hertz. `usvauv_env.scenario` puts them together.
"""
