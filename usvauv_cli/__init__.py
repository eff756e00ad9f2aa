"""The command line: `app` is the entry point, `commands` has the commands, `terminal` prints for them,
`usage` and `kinds` say what is meant where the command line names what there is not, or a file of another kind.

`evaluation` runs policies in the same worlds, `sweep` performs many runs on an engine, `reproduction` those of the
paper; `web_report` writes their pages. `live` shows a mission in a browser tab while it runs, `planning` and `sea_view`
have the views of two commands. Other packages import nothing from here.
"""
