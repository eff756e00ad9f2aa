"""Taichi kernels: every loop over cells, vortices, hydrophones and worlds. Arrays in, arrays out."""

import os

# Taichi otherwise prints a banner when it is imported.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "False")
