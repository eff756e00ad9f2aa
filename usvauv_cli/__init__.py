"""The command line: `app` is its entrance and knows the commands, `commands` has them, `terminal` prints for them.

`evaluation` runs policies side by side, `sweep` does many runs on an engine, `reproduction` those of the paper;
`web_report` writes their pages. `live` shows a mission in a browser tab while it runs, `planning` and `sea_view` are
the views of two commands. Other packages import nothing from here.
"""
