"""Taichi kernels: every loop over cells, vortices, hydrophones and worlds. Arrays in, arrays out.

Subpackages: `shallow_water`, `flow`, `positioning`, `tracking`, `planning`, `vehicles`, `guidance`, `mission`. Common
modules: `runtime` starts Taichi, `functions` makes kernels and binds them to their arrays, `types` names arguments and
columns, `network` evaluates networks, `random` draws random numbers, `registry` holds items to which plugins add.
"""

import os
import warnings

# Without HOME Taichi aborts the process at its import; "~" stays where the system knows no folder of the user.
os.environ.setdefault("HOME", os.path.expanduser("~").replace("~", "/"))
# Taichi otherwise prints a banner when it is imported.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "False")
# In a notebook it otherwise says at its import that it collects what kernels print; without that the text goes to the
# process's standard output, which a notebook shows as well.
os.environ.setdefault("TI_ENABLE_PYBUF", "0")
# Its import warns of a docstring, from Python 3.12 on with a line at each import where its files are not stored
# compiled, and of a deprecated function, which ends the import where all warnings are errors.
for _category in (SyntaxWarning, DeprecationWarning):
    warnings.filterwarnings("ignore", category=_category, module=r"(.*[/\\])?taichi[./\\]")
