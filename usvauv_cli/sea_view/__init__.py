"""Views of the sea alone for `usvauv sea`: `video`, `figure`, and what both use (`surface`)."""
