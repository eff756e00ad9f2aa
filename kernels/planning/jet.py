"""Jets: numbers with their derivatives with respect to the boat's position (x, y), and the rules of calculus.

A jet is a vec6 (f, f_x, f_y, f_xx, f_xy, f_yy). Sums and multiples by a constant are those of vectors.
"""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.types import vec2, vec3, vec6

VALUE, X, Y, XX, XY, YY = range(6)


@func
def product(u: vec6, v: vec6) -> vec6:
    """u v."""
    return vec6(
        u[VALUE] * v[VALUE],
        u[X] * v[VALUE] + u[VALUE] * v[X],
        u[Y] * v[VALUE] + u[VALUE] * v[Y],
        u[XX] * v[VALUE] + 2.0 * u[X] * v[X] + u[VALUE] * v[XX],
        u[XY] * v[VALUE] + u[X] * v[Y] + u[Y] * v[X] + u[VALUE] * v[XY],
        u[YY] * v[VALUE] + 2.0 * u[Y] * v[Y] + u[VALUE] * v[YY],
    )


@func
def square(u: vec6) -> vec6:
    """u²; fewer operations than `product`."""
    return vec6(
        u[VALUE] * u[VALUE],
        2.0 * u[VALUE] * u[X],
        2.0 * u[VALUE] * u[Y],
        2.0 * (u[X] * u[X] + u[VALUE] * u[XX]),
        2.0 * (u[X] * u[Y] + u[VALUE] * u[XY]),
        2.0 * (u[Y] * u[Y] + u[VALUE] * u[YY]),
    )


@func
def add_gradient_product(u: vec6, factor) -> vec6:
    """u with `factor` ∇u ∇uᵀ added to its Hessian, as the chain rule of exponential and logarithm asks for."""
    f = u
    f[XX] += factor * u[X] * u[X]
    f[XY] += factor * u[X] * u[Y]
    f[YY] += factor * u[Y] * u[Y]
    return f


@func
def logarithm(u: vec6) -> vec6:
    """ln u."""
    f = add_gradient_product(u / u[VALUE], -1.0)
    f[VALUE] = ti.log(u[VALUE])
    return f


@func
def of_squared_distance(g: vec3, dx, dy) -> vec6:
    """A function g(q), g'(q), g''(q) of q = dx² + dy² + a constant; dx and dy are the boat's place minus another."""
    g1 = 2.0 * g[1]  # the derivatives of q by x and y are 2 dx, 2 dy and 2
    g2 = 4.0 * g[2]
    return vec6(g[0], g1 * dx, g1 * dy, g1 + g2 * dx * dx, g2 * dx * dy, g1 + g2 * dy * dy)


@func
def turned(u: vec6, axis: vec2) -> vec6:
    """A jet by distances along `axis` (of length one) and to its left, as the jet by x and y."""
    c = axis[0]
    s = axis[1]
    return vec6(
        u[VALUE],
        c * u[X] - s * u[Y],
        s * u[X] + c * u[Y],
        c * c * u[XX] - 2.0 * c * s * u[XY] + s * s * u[YY],
        c * s * (u[XX] - u[YY]) + (c * c - s * s) * u[XY],
        s * s * u[XX] + 2.0 * c * s * u[XY] + c * c * u[YY],
    )
