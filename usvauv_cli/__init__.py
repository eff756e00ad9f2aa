"""The command line: `app` is its entrance, `parser` knows the commands, `commands` has them.

`evaluation` runs policies side by side, `sweep` does many runs on an engine, `reproduction` those of the paper;
`web_report` writes their pages, `report` and `tables` print to the terminal. `live` shows a mission in a browser tab
while it runs, `planning` and `sea_view` are the views of two commands. Other packages import nothing from here.
"""
