"""Counter-based random numbers: a draw is a pure function of its address, whatever the threads and the order of calls.

Philox4x32-10 (Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC'11,
doi 10.1145/2063384.2063405). The key is the 64-bit seed, its low word first; the counter is the address (world,
episode, step, draw). So an episode is the same for any number of worlds and threads.
"""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.types import vec2, vec4

uint2 = ti.types.vector(2, ti.u32)
uint4 = ti.types.vector(4, ti.u32)


@func
def philox(counter: uint4, key: uint2) -> uint4:
    """Ten rounds of Philox4x32: four independent 32-bit words for one 128-bit counter and one 64-bit key."""
    c = counter
    k0 = key[0]
    k1 = key[1]
    for _ in range(10):
        product0 = ti.u64(0xD2511F53) * ti.cast(c[0], ti.u64)
        product1 = ti.u64(0xCD9E8D57) * ti.cast(c[2], ti.u64)
        high0 = ti.cast(ti.bit_shr(product0, 32), ti.u32)
        high1 = ti.cast(ti.bit_shr(product1, 32), ti.u32)
        c = uint4(
            high1 ^ c[1] ^ k0,
            ti.cast(product1, ti.u32),
            high0 ^ c[3] ^ k1,
            ti.cast(product0, ti.u32),
        )
        k0 += ti.u32(0x9E3779B9)
        k1 += ti.u32(0xBB67AE85)
    return c


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
def gaussian_pair(u: ti.f32, v: ti.f32) -> vec2:
    """Box–Muller: two independent standard normal numbers from two uniform ones."""
    radius = ti.sqrt(-2.0 * ti.log(u))
    angle = 6.283185307179586 * v
    return vec2(radius * ti.cos(angle), radius * ti.sin(angle))


@func
def normals(address: uint4, key: uint2) -> vec4:
    """Four independent standard normal numbers."""
    u = uniforms(address, key)
    a = gaussian_pair(u[0], u[1])
    b = gaussian_pair(u[2], u[3])
    return vec4(a[0], a[1], b[0], b[1])
