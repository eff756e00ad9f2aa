"""Views of the sea alone for `usvauv sea`: video (`video`, with `block` and `section`) and figure (`figure`)."""
