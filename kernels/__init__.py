"""Taichi kernels: every loop over cells, vortices, hydrophones and worlds. Arrays in, arrays out."""
