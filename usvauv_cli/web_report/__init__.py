"""The page of `usvauv eval --report`: scores with intervals, figures, and a player of one episode, in one HTML file.

`episodes.Recordings` keeps what the page shows of the traces, `page.write` writes the folder. What pages of other
commands have too is in `document` and `base.html`.
"""
