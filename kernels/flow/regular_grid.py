"""Fields on a regular grid of nodes whose corners are the area's corners.

A field is (levels, rows, columns, components), at least 2 rows and columns, row 0 in the south, column 0 in the west;
between nodes it is bilinear, outside the area it is that of the nearest edge.
"""

import taichi as ti


@ti.func
def interpolate(field: ti.template(), level: ti.i32, component: ti.template(), column: ti.f32, row: ti.f32) -> ti.f32:
    """Value at a fractional column and row of the grid."""
    i = ti.math.clamp(ti.cast(row, ti.i32), 0, field.shape[1] - 2)
    j = ti.math.clamp(ti.cast(column, ti.i32), 0, field.shape[2] - 2)
    south = field[level, i, j, component]
    south += (column - j) * (field[level, i, j + 1, component] - south)
    north = field[level, i + 1, j, component]
    north += (column - j) * (field[level, i + 1, j + 1, component] - north)
    return south + (row - i) * (north - south)


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
    column = ti.math.clamp(x / width, 0.0, 1.0) * (field.shape[2] - 1)
    row = ti.math.clamp(y / length, 0.0, 1.0) * (field.shape[1] - 1)
    return interpolate(field, level, component, column, row)
