"""Numbers that the functions of `otter` read, and the longest substep that its motion allows."""

import math
from collections.abc import Mapping

import numpy as np

from usvauv.kernels.columns import Columns
from usvauv.kernels.vehicles import stability

LONGEST, SHORTEST = 0.2, 5e-4  # s, of a substep
STABLE = 2.7  # longest substep times the fastest rate; Runge–Kutta of fourth order is stable up to 2.78
STABLE_SPIN = 2.0  # the same for the rate of damping of a spin alone, which grows while the boat slips
MOST_PARTS = 400  # of a substep
SHARES = 5  # of thrust for turning, for which speeds are reckoned
FASTEST, SPINNING = 50.0, 20.0  # m/s and rad/s that no boat reaches
AIR = 1.225  # kg/m³
SEA_WATER = 1025.0  # kg/m³


class Number(Columns):
    """Numbers read by the functions, (N,)."""

    m11: int
    m22: int
    m23: int
    m33: int
    inverse_22: int  # of the block of sway and yaw
    inverse_23: int
    inverse_33: int
    length: int
    damping_surge: int
    damping_sway: int
    damping_yaw: int
    damping_turn: int  # d_rr
    cross_flow: int  # ½ρ C_d T
    ahead: int  # k
    astern: int  # k'
    most_ahead: int  # thrust of one propeller, N
    most_astern: int
    lever: int
    lag: int
    wind_surge: int  # ½ρ_a c_x A_F
    wind_sway: int
    wind_yaw: int  # ρ_a c_n A_L L
    turn_rate: int
    heading_gain: int  # ω_h, 1/s
    rate_gain: int  # 1/s
    speed_gain: int  # 1/s
    heading_sum: int  # gain of the error's integral, 1/s³
    speed_sum: int  # 1/s²
    substep: int  # the longest, s


def fastest_squared(table, u, v, r, wind):
    """Square of an upper bound on the rates of change of small motions, 1/s²: damping, and what couples them.

    In a kernel or outside, so that it has only what Python and Taichi share.

    Args:
        table: of `Number`.
        u, v, r: magnitudes of the velocities, m/s and rad/s.
        wind: speed of the wind relative to the boat, m/s.
    """
    length, flow = table[Number.length], table[Number.cross_flow]
    m11, m22, m23 = table[Number.m11], table[Number.m22], abs(table[Number.m23])
    light, turn = table[Number.inverse_22], table[Number.inverse_33]
    surge = (table[Number.damping_surge] + 2.0 * table[Number.wind_surge] * wind) / m11
    sway = (table[Number.damping_sway] + 2.0 * flow * length * v + 2.0 * table[Number.wind_sway] * wind) * light
    along = flow * length**3 * max(v / 6.0, r * length / 16.0)
    yaw = (table[Number.damping_yaw] + 2.0 * table[Number.damping_turn] * r + along) * turn
    munk = abs(m22 - m11)
    damped = max(max(surge, sway), yaw)
    coupled = (
        r * r
        + (m22 * v + 2.0 * m23 * r) * (munk * v + m23 * r) * turn / m11
        + m11 * munk * light * turn * u * u
        + table[Number.wind_yaw] * turn * wind * wind
    )
    return damped * damped + coupled


def balance(linear: float, quadratic: float, force: float, most: float) -> float:
    """Speed at which a linear and a quadratic drag are a force, up to `most`."""
    root = math.sqrt(linear * linear + 4 * quadratic * force)
    return min(2 * force / (linear + root), most) if linear + root > 0 else most * (force > 0)


def longest_substep(table: np.ndarray, wind: float) -> float:
    """The longest substep that is stable at the speeds that thrust and a wind (m/s) give the boat, s.

    The autopilot, which gives its orders once a substep, is fast enough with it too.
    """
    t = [float(number) for number in table]
    ahead, astern = t[Number.most_ahead], t[Number.most_astern]
    turn = t[Number.damping_turn] + t[Number.cross_flow] * t[Number.length] ** 4 / 32
    rate = 0.0
    for share in np.linspace(0.0, 1.0, SHARES):  # of the greatest difference of thrust, which the sum lacks
        difference = share * (ahead + astern)
        pushed = 2 * max(ahead, astern) - difference + t[Number.wind_surge] * wind**2
        u = balance(t[Number.damping_surge], 0.0, pushed, FASTEST)
        turned = t[Number.lever] * difference + 0.5 * t[Number.wind_yaw] * wind**2
        r = balance(t[Number.damping_yaw], turn, turned, SPINNING)
        across = t[Number.wind_sway] * wind**2 + t[Number.m11] * u * r
        v = balance(t[Number.damping_sway], t[Number.cross_flow] * t[Number.length], across, FASTEST)
        rate = max(rate, math.sqrt(fastest_squared(t, u, v, r, wind)))
    loops = max(t[Number.rate_gain] * t[Number.m33] * t[Number.inverse_33], t[Number.speed_gain])
    return min(LONGEST, STABLE / rate, 1.0 / loops)


def table_of(numbers: Mapping[str, float], wind: float = 0.0) -> np.ndarray:
    """`Number` (N,) float32 of the numbers of the section `otter`, in winds up to some speed, m/s."""
    n = dict(numbers)
    m23 = n["mass"] * n["centre"]
    m22 = n["mass"] + n["added_sway"]
    m33 = n["inertia"] + n["mass"] * n["centre"] ** 2 + n["added_yaw"]
    determinant = m22 * m33 - m23**2
    table = np.array(
        [
            n["mass"] + n["added_surge"],
            m22,
            m23,
            m33,
            m33 / determinant,
            -m23 / determinant,
            m22 / determinant,
            n["length"],
            n["damping_surge"],
            n["damping_sway"],
            n["damping_yaw"],
            n["damping_turn"],
            0.5 * SEA_WATER * n["cross_flow"] * n["draught"],
            n["thrust_ahead"],
            n["thrust_astern"],
            n["thrust_ahead"] * n["most_ahead"] ** 2,
            n["thrust_astern"] * n["most_astern"] ** 2,
            n["lever"],
            n["propeller_lag"],
            0.5 * AIR * n["wind_surge"] * n["frontal_area"],
            0.5 * AIR * n["wind_sway"] * n["lateral_area"],
            AIR * n["wind_yaw"] * n["lateral_area"] * n["length"],
            n["turn_rate"],
            n["heading_gain"],
            n["rate_gain"],
            n["speed_gain"],
            0.1 * (n["heading_gain"] * n["rate_gain"]) ** 1.5,
            0.1 * n["speed_gain"] ** 2,
            LONGEST,
        ],
        np.float32,
    )
    table[Number.substep] = longest_substep(table, wind)
    return table


def check(numbers: Mapping[str, float], usual: Mapping[str, float], wind: float) -> None:
    """Refuse numbers with which the boat moves too fast for any substep, in winds up to some speed, m/s.

    Args:
        usual: their defaults.

    Raises:
        ValueError: it does; the message names a number.
    """
    problem = f"moves too fast for substeps of {1e3 * SHORTEST:g} ms in a wind of {wind:.3g} m/s"
    stability.admitted(numbers, usual, lambda n: float(table_of(n, wind)[Number.substep]), SHORTEST, problem)


def top_speed(numbers: Mapping[str, float]) -> float:
    """Speed through the water at full thrust in calm air, m/s: 2 k n²/d_u."""
    return 2 * numbers["thrust_ahead"] * numbers["most_ahead"] ** 2 / numbers["damping_surge"]


def response_time(numbers: Mapping[str, float]) -> float:
    """Time in which its speed follows a command, s: of the loop 1/(d_u/m11 + ω_u), and the propellers' lag."""
    mass = numbers["mass"] + numbers["added_surge"]
    return 1 / (numbers["damping_surge"] / mass + numbers["speed_gain"]) + numbers["propeller_lag"]
