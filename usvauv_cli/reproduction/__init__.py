"""The paper's Table 2, Fig. 3 and Fig. 4 reproduced, and the data collected with each boat strategy.

`paper` has settings and runs, which `usvauv.cli.sweep` performs; each table or figure has its runs, and a function that
draws it and returns its part of the page.
"""
