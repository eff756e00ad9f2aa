"""The paper's Table 2, Fig. 3 and Fig. 4 made again: settings, resumable pieces of work, figures, a page.

`targets.reproduce` is the entrance; each table or figure has a file that names its pieces of work and draws it.
"""
