"""The command line: `app` is its entrance, `parser` knows the commands, `commands` has one file for each of them,
`reproduction` makes the paper's results.

`encoder` writes a mission's video, `report` the tables in the terminal, `plan_figure` and `sea_view` the views of two
commands, `figure_theme` the look of all figures. Nothing here is meant to be imported by other packages.
"""
