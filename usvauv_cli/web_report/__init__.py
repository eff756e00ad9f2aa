"""The page of `usvauv eval --report`: scores with intervals, figures, and a player of one episode, in one HTML file.

`episodes.Recordings` keeps the data that the page shows, `page.write` writes the folder. Common parts of pages of all
commands are in `document` and `base.html`.
"""
