"""Meshes of vehicles and nodes, of about unit size, bow towards +x, up +z; rotations as quaternions (w, x, y, z)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np


class Shape(NamedTuple):
    """Triangles: vertices (V, 3) float32 and their indices (F, 3)."""

    vertices: np.ndarray
    faces: np.ndarray

    def scaled(self, size: float) -> np.ndarray:
        """Vertices of a shape of another size."""
        return (self.vertices * size).astype(np.float32)


def lofted(sections: list[np.ndarray]) -> Shape:
    """A closed body through sections of equally many points (N, 3), each a ring."""
    count = len(sections[0])
    faces = []
    for first in range(0, count * (len(sections) - 1), count):
        for i in range(count):
            a, b = first + i, first + (i + 1) % count
            faces += [(a, b, b + count), (a, b + count, a + count)]
    ends = [section.mean(axis=0) for section in (sections[0], sections[-1])]
    start, end = count * len(sections), count * len(sections) + 1
    for i in range(count):
        j = (i + 1) % count
        faces += [(start, j, i), (end, start - count + i, start - count + j)]
    return Shape(np.concatenate([*sections, ends]).astype(np.float32), np.array(faces, np.uint32))


def joined(*shapes: Shape) -> Shape:
    """Several bodies as one."""
    offsets = np.cumsum([0, *(len(shape.vertices) for shape in shapes[:-1])])
    faces = [shape.faces + np.uint32(offset) for shape, offset in zip(shapes, offsets, strict=True)]
    return Shape(np.concatenate([shape.vertices for shape in shapes]), np.concatenate(faces))


def _box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Shape:
    (x0, y0, z0), (x1, y1, z1) = low, high
    corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
    return lofted([np.column_stack([corners, np.full(4, z)]) for z in (z0, z1)])


def _outline(beam: float, height: float, length: float = 1.0) -> np.ndarray:
    """A deck with a pointed bow, anticlockwise from above."""
    x = length * np.array([-0.5, 0.1, 0.35, 0.5, 0.35, 0.1, -0.5])
    y = beam * np.array([-0.45, -0.5, -0.3, 0.0, 0.3, 0.5, 0.45])
    return np.column_stack([x, y, np.full(7, height)])


def hull() -> Shape:
    """A boat's hull, its water line at z = 0."""
    return lofted([_outline(0.16, -0.14, 0.85), _outline(0.38, 0.0, 0.95), _outline(0.42, 0.14)])


def cabin() -> Shape:
    """What stands on its deck: a cabin and a mast."""
    return joined(_box((-0.32, -0.13, 0.14), (0.08, 0.13, 0.32)), _box((-0.2, -0.015, 0.32), (-0.17, 0.015, 0.6)))


def torpedo() -> Shape:
    """An AUV: a round body with fins at its stern."""
    profile = ((-0.5, 0.03), (-0.34, 0.1), (0.3, 0.12), (0.42, 0.1), (0.48, 0.06), (0.5, 0.02))
    angles = np.linspace(0, 2 * math.pi, 14, endpoint=False)
    rings = [np.column_stack([np.full(14, x), r * np.cos(angles), r * np.sin(angles)]) for x, r in profile]
    across = _box((-0.5, -0.22, -0.012), (-0.36, 0.22, 0.012))
    upright = _box((-0.5, -0.012, -0.22), (-0.36, 0.012, 0.22))
    return joined(lofted(rings), across, upright)


def sensor() -> Shape:
    """A node: a short drum on a foot, its foot at z = 0."""
    angles = np.linspace(0, 2 * math.pi, 16, endpoint=False)
    profile = ((0.5, 0.0), (0.5, 0.1), (0.33, 0.14), (0.33, 0.75), (0.2, 0.95))
    return lofted([np.column_stack([r * np.cos(angles), r * np.sin(angles), np.full(16, z)]) for r, z in profile])


def ball() -> Shape:
    """A sphere of diameter 1."""
    angles = np.linspace(0, 2 * math.pi, 16, endpoint=False)
    rings = []
    for latitude in np.linspace(-0.48, 0.48, 9) * math.pi:
        r, z = 0.5 * math.cos(latitude), 0.5 * math.sin(latitude)
        rings.append(np.column_stack([r * np.cos(angles), r * np.sin(angles), np.full(16, z)]))
    return lofted(rings)


def field_faces(columns: int, rows: int) -> np.ndarray:
    """Triangles (F, 3) of a field of points, row by row, facing up."""
    index = np.arange(rows * columns, dtype=np.uint32).reshape(rows, columns)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    return np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])


def turned(heading: float) -> np.ndarray:
    """Rotation about the vertical, anticlockwise from east, rad."""
    return np.array([math.cos(heading / 2), 0.0, 0.0, math.sin(heading / 2)])


def tilted(heading: float, slope: np.ndarray) -> np.ndarray:
    """The same on a surface of a slope (2,): what stands upright is then normal to it."""
    normal = np.array([-slope[0], -slope[1], 1.0]) / math.sqrt(1 + float(slope @ slope))
    w, x, y = 1 + normal[2], -normal[1], normal[0]  # from (0, 0, 1) to the normal: their cross product is (x, y, 0)
    w, x, y = np.array([w, x, y]) / math.sqrt(w * w + x * x + y * y)
    c, s = math.cos(heading / 2), math.sin(heading / 2)
    return np.array([w * c, x * c + y * s, y * c - x * s, w * s])
