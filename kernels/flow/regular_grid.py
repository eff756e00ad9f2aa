"""Fields on a regular grid of nodes whose corners are the area's corners.

A field is (levels, rows, columns, components), at least 2 rows and columns, row 0 in the south, column 0 in the west;
between nodes it is bilinear, outside the area it is that of the nearest edge.
"""

import taichi as ti


@ti.func
def sample(
    field: ti.template(),
    level: ti.i32,
    component: ti.template(),
    x: ti.f32,
    y: ti.f32,
    width: ti.f32,
    length: ti.f32,
) -> ti.f32:
    """Value at (x, y) in an area of the given size, m."""
    last_row = field.shape[1] - 1
    last_column = field.shape[2] - 1
    p = ti.math.clamp(x / width, 0.0, 1.0) * last_column
    q = ti.math.clamp(y / length, 0.0, 1.0) * last_row
    j = ti.min(ti.cast(p, ti.i32), last_column - 1)
    i = ti.min(ti.cast(q, ti.i32), last_row - 1)
    south = field[level, i, j, component]
    south += (p - j) * (field[level, i, j + 1, component] - south)
    north = field[level, i + 1, j, component]
    north += (p - j) * (field[level, i + 1, j + 1, component] - north)
    return south + (q - i) * (north - south)
