"""Types of Taichi arguments, and classes of column numbers."""

import taichi as ti


def columns(*names: str) -> type:
    """A class whose attributes are the column numbers of the given names, in order."""
    return type("Columns", (), {**{name: index for index, name in enumerate(names)}, "names": names})


Level = columns("surface", "cruise")
vec2 = ti.types.vector(2, ti.f32)
vec3 = ti.types.vector(3, ti.f32)
array1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
array2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
array3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
array4 = ti.types.ndarray(dtype=ti.f32, ndim=4)
index1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
index2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
index3 = ti.types.ndarray(dtype=ti.i32, ndim=3)
mask1 = ti.types.ndarray(dtype=ti.u8, ndim=1)
