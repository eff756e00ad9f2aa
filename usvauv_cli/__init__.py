"""The command line: `app` is the entry point, `commands` has the commands, `terminal` prints for them,
`usage` says what is meant where the command line names what there is not, or a file of another kind.

`evaluation` runs policies in the same worlds, `sweep` performs many runs on an engine, `reproduction` those of the
paper; `web_report` writes their pages. `live` shows a mission in a browser tab while it runs, `boat_placement` and
`sea_view` have the views of two commands. Other packages import nothing from here.
"""

import os

# NumPy's products of matrices are small here. A second thread gains little, and while another process or thread keeps
# its core busy the first one waits for it at full load. Read when NumPy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
