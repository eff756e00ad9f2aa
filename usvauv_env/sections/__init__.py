"""The sections of a scenario: every number, with its range, unit and meaning.

All values are SI: metres, seconds, radians, watts, hertz. `usvauv.env.scenario` puts them together.
"""
