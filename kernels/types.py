"""Types of Taichi arguments."""

from typing import Any

import taichi as ti

from usvauv.kernels.columns import Columns
from usvauv.kernels.columns import columns as columns

vec2 = ti.types.vector(2, ti.f32)
ivec2 = ti.types.vector(2, ti.i32)
vec3 = ti.types.vector(3, ti.f32)
vec4 = ti.types.vector(4, ti.f32)
vec5 = ti.types.vector(5, ti.f32)
vec6 = ti.types.vector(6, ti.f32)
mat2 = ti.types.matrix(2, 2, ti.f32)
mat3 = ti.types.matrix(3, 3, ti.f32)
array1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
array2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
array3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
array4 = ti.types.ndarray(dtype=ti.f32, ndim=4)
double1 = ti.types.ndarray(dtype=ti.f64, ndim=1)
index1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
index2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
index3 = ti.types.ndarray(dtype=ti.i32, ndim=3)
mask1 = ti.types.ndarray(dtype=ti.u8, ndim=1)
select: Any = ti.select  # without its declared results, which cannot be indexed


class Level(Columns):
    """Levels of the water at which its velocity is known."""

    surface: int
    cruise: int
