"""The paper's Table 2, Fig. 3 and Fig. 4 reproduced, and the data collected with each boat strategy.

`paper` has settings and runs, which `usvauv.cli.sweep` does; each table or figure has the runs it needs, and a function
that draws it and returns what the page has of it.
"""
