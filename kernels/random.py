"""Counter-based random numbers: a draw is a pure function of its address, whatever the threads and the order of calls.

Philox4x32-10 (Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC'11,
doi 10.1145/2063384.2063405). The key is the 64-bit seed, its low word first; the counter is the address (world,
episode, step, draw). So an episode is the same for any number of worlds and threads.
"""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.transcendental import half_cosine, half_sine
from usvauv.kernels.types import vec2, vec4

uint2 = ti.types.vector(2, ti.u32)
uint4 = ti.types.vector(4, ti.u32)
LANE_BITS = 3
LANES = 1 << LANE_BITS  # draws side by side: four words each fill the registers
lanes = ti.types.vector(LANES, ti.f32)
long_lanes = ti.types.vector(LANES, ti.u64)


@func
def rounds(c0, c1, c2, c3, k0, k1):
    """Ten rounds of Philox4x32 on four words of a counter and two of a key: four independent words.

    Words are 64-bit numbers below 2³², or vectors of them, for which processors have instructions.
    """
    word = ti.u64(0xFFFFFFFF)
    a0, a1, a2, a3, b0, b1 = c0, c1, c2, c3, k0, k1
    for _ in range(10):
        product0 = ti.u64(0xD2511F53) * (a0 & word)
        product1 = ti.u64(0xCD9E8D57) * (a2 & word)
        a0 = (product1 >> ti.u64(32)) ^ a1 ^ b0
        a2 = (product0 >> ti.u64(32)) ^ a3 ^ b1
        a1 = product1 & word
        a3 = product0 & word
        b0 = (b0 + ti.u64(0x9E3779B9)) & word
        b1 = (b1 + ti.u64(0xBB67AE85)) & word
    return a0, a1, a2, a3


@func
def philox(counter: uint4, key: uint2) -> uint4:
    """Philox4x32-10: four independent 32-bit words for one 128-bit counter and one 64-bit key."""
    c = [ti.cast(counter[n], ti.u64) for n in ti.static(range(4))]
    a0, a1, a2, a3 = rounds(c[0], c[1], c[2], c[3], ti.cast(key[0], ti.u64), ti.cast(key[1], ti.u64))
    return ti.cast(ti.Vector([a0, a1, a2, a3]), ti.u32)


@func
def unit(word: ti.u32) -> ti.f32:
    """A 32-bit word as a number in the open interval (0, 1), on a lattice of 2⁻²³ offset by half a step."""
    return (ti.cast(ti.bit_shr(word, 9), ti.f32) + 0.5) * (1.0 / 8388608.0)


@func
def uniforms(address: uint4, key: uint2) -> vec4:
    """Four independent numbers uniform in (0, 1)."""
    w = philox(address, key)
    return vec4(unit(w[0]), unit(w[1]), unit(w[2]), unit(w[3]))


@func
def split(u: ti.f32, v: ti.f32) -> vec4:
    """Two uniform numbers as `box_muller` takes them: u = m 2ᵉ with ½√2 ≤ m < √2, and 2πv = ±(π/2 − πz), |z| ≤ ½."""
    bits = ti.bit_cast(u, ti.i32)
    exponent = (bits - 0x3F3504F3) >> 23
    t = 0.5 - v
    sign = ti.bit_cast(t, ti.i32) & ti.i32(-0x80000000)
    return vec4(
        ti.bit_cast(bits - (exponent << 23), ti.f32),
        ti.cast(exponent, ti.f32),
        2.0 * ti.abs(t) - 0.5,
        ti.bit_cast(sign | 0x3F800000, ti.f32),
    )


@func
def box_muller(m, e, z, sign):
    """Box–Muller: two independent standard normal numbers from two uniform ones, as `split` has them, or vectors.

    √(−2 ln m 2ᵉ) times cosine and sine, with ln m = 2 artanh s, s = (m − 1)/(m + 1), by polynomials in s², within 4e-7
    before rounding.
    """
    s = (m - 1.0) / (m + 1.0)
    q = s * s
    logarithm = s * (4.0 + q * (1.3333355 + q * (0.79955084 + q * 0.59743458)))
    radius = ti.sqrt(-1.3862944 * e - logarithm)
    return radius * half_sine(z), radius * sign * half_cosine(z)


@func
def gaussian_pair(u: ti.f32, v: ti.f32) -> vec2:
    """Two independent standard normal numbers from two uniform ones."""
    parts = split(u, v)
    a, b = box_muller(parts[0], parts[1], parts[2], parts[3])
    return vec2(a, b)


@func
def normals(address: uint4, key: uint2) -> vec4:
    """Four independent standard normal numbers."""
    u = uniforms(address, key)
    a = gaussian_pair(u[0], u[1])
    b = gaussian_pair(u[2], u[3])
    return vec4(a[0], a[1], b[0], b[1])


@func
def uniform_lanes(words: long_lanes) -> lanes:
    """A word of each of `LANES` draws as `unit` has it, for where vectors stay in registers."""
    return ti.Vector([unit(ti.cast(words[n], ti.u32)) for n in ti.static(range(LANES))])


@func
def gaussian_lanes(u: lanes, v: lanes):
    """`gaussian_pair` of `LANES` pairs of uniform numbers, for where vectors stay in registers."""
    parts = [split(u[n], v[n]) for n in ti.static(range(LANES))]
    columns = [ti.Vector([parts[n][c] for n in ti.static(range(LANES))]) for c in ti.static(range(4))]
    return box_muller(columns[0], columns[1], columns[2], columns[3])
