"""The command line: `app` is its entrance, `parser` knows the commands, `commands` has them,
`sweep` does many runs on an engine and writes the results of a study, `reproduction` those of the paper.

`live` shows a mission in a browser tab while it runs, `web_report`
writes the page of an evaluation, `report` and `tables` print to the terminal, `planning` and `sea_view` are the
views of two commands. Nothing here is meant to be imported by other packages.
"""
