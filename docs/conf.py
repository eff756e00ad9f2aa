"""Sphinx's settings: `sphinx-build -W --keep-going -n docs docs/_build` builds the site.

Written while it builds, and not kept by git: `gallery/` from `examples/gallery/`, `reference/` from the source.
"""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from usvauv import extend  # noqa: E402

del extend.__getattr__  # the gallery asks a package for its modules' names, and expects an AttributeError

project = "usvauv"
copyright = "2026 the usvauv authors, MIT licence"  # in the footer of each page
extensions = [
    "myst_parser",  # Markdown
    "autoapi.extension",  # docstrings from the source, which is not imported: kernels are shown as they are written
    "sphinx_gallery.gen_gallery",  # runs the examples
    "docstrings",
    "navigation",
    "pictures",
    "reference_pages",
    "references",
]
exclude_patterns = ["_build", "gallery/*.py", "gallery/*.ipynb"]

html_theme = "furo"
html_title = "usvauv"
html_static_path = ["_static"]
html_css_files = ["wide.css"]
html_copy_source = False
smartquotes = False  # they would make dashes of the two hyphens of an option
myst_heading_anchors = 4  # links to headings work as on GitHub

autoapi_dirs = ["../src/usvauv"]
autoapi_follow_symlinks = True
autoapi_ignore = ["*/usvauv/cli/commands/*"]  # they have a page of their own, as they are used
autoapi_root = "reference/api"
autoapi_add_toctree_entry = False  # index.md has them
autoapi_keep_files = False
autoapi_options = ["members", "undoc-members", "imported-members"]
add_module_names = False
autoapi_python_class_content = "both"
# Of constants that are unpacked from a range, and of annotations whose name attributes have too.
suppress_warnings = ["autoapi.python_import_resolution", "ref.python"]

# In docstrings a name of ours in single backticks is a link, and must exist. Annotations are pyright's.
default_role = "py:obj"
nitpick_ignore_regex = [("py:(?!obj).*", ".*")]

sphinx_gallery_conf = {
    "examples_dirs": "../examples/gallery",
    "gallery_dirs": "gallery",
    "filename_pattern": ".*",  # all are run; one that fails ends the build
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "show_signature": False,
    "capture_repr": ("_repr_html_",),  # tables, and traces that play
    "min_reported_time": 1,
}
