"""Types of Taichi arguments, and numbered columns of arrays."""

from typing import Annotated, Any, ClassVar, get_origin

import taichi as ti

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


class Columns:
    """Numbers the columns of an array's last axis: a subclass's annotations of type int, in their order, from 0.

    An annotation can be `Annotated[int, …]`.

    Attributes:
        names: of the columns.
    """

    names: ClassVar[tuple[str, ...]]

    def __init_subclass__(cls) -> None:
        kinds = cls.__annotations__.items()
        cls.names = tuple(name for name, kind in kinds if kind is int or get_origin(kind) is Annotated)
        for number, name in enumerate(cls.names):
            setattr(cls, name, number)

    @classmethod
    def span(cls, first: str, last: str) -> slice:
        """Columns `first` to `last`, both included."""
        return slice(cls.names.index(first), cls.names.index(last) + 1)


class Level(Columns):
    """Levels of the water at which its velocity is known."""

    surface: int
    cruise: int


def columns(*names: str) -> Any:
    """`Columns` of the given names, for a table that one file alone uses."""
    return type("Columns", (Columns,), {"__annotations__": dict.fromkeys(names, int)})
