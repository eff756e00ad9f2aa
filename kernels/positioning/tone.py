"""The record of four hydrophones, a tone in white Gaussian noise, as sums of y e^{−2πjνn} over blocks of samples.

Time is counted in periods of the carrier from the opening of the receiver's gate, ν = f/f_s periods a sample. Such
sums are all that a receiver at known frequency needs. There are two ways to get them:

- SAMPLED draws the noise of every sample and sums.
- PROJECTED draws the sums. Those of white noise over disjoint blocks are independent Gaussians with the covariance
  σ_n² Σ (cos, −sin)ᵀ(cos, −sin), in closed form. Where a receiver splits a block whose sum is drawn already, the sum of
  the part is drawn from the normal distribution conditional on that of the block.

Both have exactly the same distribution. A block is given by two edges. An edge is (n, Re F, Im F), n the first sample
of a block or the one after its last, and F(n) = Σ_{k<n} e^{4πjνk} up to a constant, so sines and cosines are needed at
edges only.
"""
# pyright: reportArgumentType=false
# (what Taichi's operations return is an expression only while a kernel is compiled)

import math

import taichi as ti

from usvauv.kernels import random
from usvauv.kernels.types import vec2, vec3, vec4

TWO_PI = 2.0 * math.pi

edges4 = ti.types.matrix(4, 3, ti.f32)


@ti.dataclass
class Record:
    """The record of the hydrophones: on each a tone, sin 2π(νn − t_i) between two edges, and noise."""

    nu: ti.f32
    half_cosecant: ti.f32  # 1/(2 sin 2πν)
    cosine: vec4  # of 2π t_i
    sine: vec4
    first: edges4
    last: edges4
    noise: ti.f32  # standard deviation of a sample
    stream: random.uint4  # key and half the counter of the draws


@ti.func
def fraction(turns):
    """Turns modulo one, in [−½, ½]."""
    return turns - ti.round(turns)


@ti.func
def direction(turns: ti.f32) -> vec2:
    """Cosine and sine of 2π · turns, each within 4e-7, without a call of the C library."""
    quarter = ti.round(4.0 * turns)
    x = TWO_PI * (turns - 0.25 * quarter)
    xx = x * x
    sine = x * (1.0 + xx * (-1.0 / 6.0 + xx * (1.0 / 120.0 + xx * (-1.0 / 5040.0 + xx / 362880.0))))
    cosine = 1.0 + xx * (-0.5 + xx * (1.0 / 24.0 + xx * (-1.0 / 720.0 + xx / 40320.0)))
    which = ti.cast(quarter, ti.i32) & 3
    swapped = (which & 1) != 0
    c = ti.select(swapped, sine, cosine)
    s = ti.select(swapped, cosine, sine)
    return vec2(ti.select(which == 1 or which == 2, -c, c), ti.select(which >= 2, -s, s))


@ti.func
def rayleigh(u: ti.f32) -> ti.f32:
    """√(−2 ln u) of a number in (0, 1), to 1e-6, without a call of the C library.

    u = 2^e (1 + s)/(1 − s) with 1 + s over 1 − s between √½ and √2, and ln (1 + s)/(1 − s) = 2 (s + s³/3 + s⁵/5 + …).
    """
    bits = ti.bit_cast(u, ti.i32)
    exponent = (bits - 0x3F3504F3) >> 23  # the float √½, at which the mantissa's octave is cut
    mantissa = ti.bit_cast(bits - (exponent << 23), ti.f32)
    s = (mantissa - 1.0) / (mantissa + 1.0)
    ss = s * s
    log = 2.0 * s * (1.0 + ss * (1.0 / 3.0 + ss * (0.2 + ss / 7.0)))
    return ti.sqrt(-2.0 * (log + 0.6931471805599453 * ti.cast(exponent, ti.f32)))


@ti.func
def normals(address: random.uint4, stream: random.uint4) -> vec4:
    """As `random.normals` with the key in the stream; with the functions above a sampled fix takes half the time."""
    u = random.uniforms(address, random.uint2(stream[0], stream[1]))
    a = rayleigh(u[0]) * direction(u[1])
    b = rayleigh(u[2]) * direction(u[3])
    return vec4(a[0], a[1], b[0], b[1])


@ti.func
def edge(time: ti.f32, nu: ti.f32, half_cosecant: ti.f32) -> vec3:
    """The edge before the first sample at or after a time in periods."""
    n = ti.ceil(time / nu)
    angle = direction(nu * (2.0 * n - 1.0))
    return vec3(n, half_cosecant * angle[1], -half_cosecant * angle[0])


@ti.func
def tone_edges(arrival: vec4, periods: ti.f32, nu: ti.f32, half_cosecant: ti.f32):
    """On each hydrophone, the edge before the tone's first sample and the one after its last; arrival in periods."""
    first = edges4(0.0)
    last = edges4(0.0)
    for i in ti.static(range(4)):
        begin = edge(arrival[i], nu, half_cosecant)
        end = edge(arrival[i] + periods, nu, half_cosecant)
        for j in ti.static(range(3)):
            first[i, j] = begin[j]
            last[i, j] = end[j]
    return first, last


@ti.func
def gram(begin: vec3, end: vec3) -> vec3:
    """Sums of cos², −cos·sin and sin² of 2πνn over the samples between two edges."""
    d = end - begin
    return 0.5 * vec3(d[0] + d[1], -d[2], d[0] - d[1])


@ti.func
def root(q: vec3) -> vec3:
    """Lower triangle (xx, xy, yy) of a 2 × 2 covariance (xx, xy, yy), singular ones included."""
    a = ti.sqrt(ti.max(q[0], 0.0))
    b = q[1] / ti.max(a, 1e-10)
    return vec3(a, b, ti.sqrt(ti.max(q[2] - b * b, 0.0)))


@ti.func
def edge_of(edges: ti.template(), i) -> vec3:
    """Row i of several edges."""
    return vec3(edges[i, 0], edges[i, 1], edges[i, 2])


@ti.func
def tone_sum(record: ti.template(), i, begin: vec3, end: vec3) -> vec2:
    """Sum of the noiseless tone on hydrophone i times e^{−2πjνn} over the samples between two edges."""
    first = begin if begin[0] > record.first[i, 0] else edge_of(record.first, i)
    last = end if end[0] < record.last[i, 0] else edge_of(record.last, i)
    sums = vec2(0.0, 0.0)
    if last[0] > first[0]:
        g = gram(first, last)
        c = record.cosine[i]
        s = record.sine[i]
        sums = vec2(-c * g[1] - s * g[0], -c * g[2] - s * g[1])
    return sums


@ti.func
def sampled_sums(record: ti.template(), begin: vec4, end: vec4):
    """Sums of y e^{−2πjνn} over the samples from begin to end − 1 of each hydrophone: real parts, imaginary parts."""
    real = vec4(0.0)
    imaginary = vec4(0.0)
    stream = record.stream
    for sample in range(ti.cast(begin.min(), ti.i32), ti.cast(end.max(), ti.i32)):
        n = ti.cast(sample, ti.f32)
        angle = direction(record.nu * n)
        cosine = angle[0]
        sine = angle[1]
        y = record.noise * normals(random.uint4(ti.cast(sample, ti.u32), ti.u32(0), stream[2], stream[3]), stream)
        for i in ti.static(range(4)):
            if n >= record.first[i, 0] and n < record.last[i, 0]:
                y[i] += sine * record.cosine[i] - cosine * record.sine[i]
            if n >= begin[i] and n < end[i]:
                real[i] += y[i] * cosine
                imaginary[i] -= y[i] * sine
    return real, imaginary


@ti.func
def projected_sums(record: ti.template(), begin: vec3, end: vec3):
    """`sampled_sums` of a block with the same edges on all hydrophones, drawn as sums."""
    real = vec4(0.0)
    imaginary = vec4(0.0)
    stream = record.stream
    L = record.noise * root(gram(begin, end))
    address = random.uint4(ti.cast(begin[0], ti.u32), ti.u32(1), stream[2], stream[3])
    u = normals(address, stream)
    address[1] = ti.u32(2)
    v = normals(address, stream)
    for i in ti.static(range(4)):
        tone = tone_sum(record, i, begin, end)
        real[i] = tone[0] + L[0] * u[i]
        imaginary[i] = tone[1] + L[1] * u[i] + L[2] * v[i]
    return real, imaginary


@ti.func
def sum_of_part(record: ti.template(), i, block_begin, block_end, begin, end, total: vec2, draw: vec2) -> vec2:
    """Sum over the part from begin to end of a block on hydrophone i, drawn conditional on the block's sum `total`."""
    Q = gram(block_begin, block_end)
    P = gram(begin, end)
    e = total - tone_sum(record, i, block_begin, block_end)
    # K = P Q⁻¹, mean K e, covariance P − K P.
    scale = 1.0 / (Q[0] * Q[2] - Q[1] * Q[1])
    k00 = scale * (P[0] * Q[2] - P[1] * Q[1])
    k01 = scale * (P[1] * Q[0] - P[0] * Q[1])
    k10 = scale * (P[1] * Q[2] - P[2] * Q[1])
    k11 = scale * (P[2] * Q[0] - P[1] * Q[1])
    L = record.noise * root(
        vec3(P[0] - k00 * P[0] - k01 * P[1], P[1] - k10 * P[0] - k11 * P[1], P[2] - k10 * P[1] - k11 * P[2])
    )
    tone = tone_sum(record, i, begin, end)
    return tone + vec2(
        k00 * e[0] + k01 * e[1] + L[0] * draw[0], k10 * e[0] + k11 * e[1] + L[1] * draw[0] + L[2] * draw[1]
    )
