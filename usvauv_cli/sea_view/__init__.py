"""Views of the sea alone for `usvauv sea`: `video`, `figure`, and their common parts (`surface`)."""
