"""How short substeps have to be, by the fastest motion that a vehicle's numbers give it; those of a torpedo.

A substep h is stable where |R(λh)| ≤ 1 for each eigenvalue λ of the linearised motion that decays, with R(z) = 1 + z +
z²/2 for the midpoint rule; and it follows motion that grows where |λh| ≤ 1.
"""

import itertools
import math
from collections.abc import Callable, Mapping

import numpy as np

from usvauv.kernels.vehicles import gains
from usvauv.kernels.vehicles.numbers import GRAVITY, NUMBERS, Constant, constants_of

SUBSTEP, SHORTEST = 0.05, 1e-3  # s, of a torpedo's substep; shorter ones take too long
MARGIN = 1.25  # of the substep below the limit
GROWTH = 1e-4  # 1/s, of an undamped oscillation
FASTEST, MOST = 2.5, 15.0  # m/s, of commands in a mission, and that no AUV reaches
DRIFT = 0.5  # speed across over that ahead, at which a drift angle is 30°
SEARCHES = 40  # halvings of an interval in which a limit lies
ALL_NUMBERS = {**NUMBERS, **gains.NUMBERS}  # of a torpedo and its autopilot
USUAL = {name: number.default for name, number in ALL_NUMBERS.items()}


def admitted(
    numbers: Mapping[str, float],
    usual: Mapping[str, float],
    longest: Callable[[Mapping[str, float]], float],
    shortest: float,
    problem: str,
) -> float:
    """The longest substep of numbers, s.

    Args:
        usual: their defaults.
        longest: of such numbers.
        shortest: that is accepted.
        problem: with a shorter one.

    Raises:
        ValueError: it is shorter. The message names the number that shortens it most, and what is allowed beside the
            others.
    """
    found = longest(numbers)
    if found >= shortest:
        return found
    changed = [name for name, value in usual.items() if name in numbers and numbers[name] != value]
    name = max(changed, key=lambda each: longest({**numbers, each: usual[each]}))
    good, bad = usual[name], numbers[name]
    allowed = f"nearer to its default, {good:g}"
    if longest({**numbers, name: good}) >= shortest:
        for _ in range(SEARCHES):
            middle = 0.5 * (good + bad)
            good, bad = (middle, bad) if longest({**numbers, name: middle}) >= shortest else (good, middle)
        allowed = f"at {'most' if good < bad else 'least'} {good:.3g}"
    raise ValueError(f"{name} = {numbers[name]:g}: {problem}: must be {allowed} with the other numbers")


def stable(eigenvalues: np.ndarray, longest: float, shortest: float) -> float:
    """The longest stable substep up to `longest` for the midpoint rule, s; below `shortest` if there is none."""
    step = longest
    while step >= shortest:
        z = MARGIN * step * eigenvalues
        growth = np.where(np.real(eigenvalues) > GROWTH, np.abs(z), np.abs(1.0 + z + 0.5 * z * z))
        if (growth <= np.exp(MARGIN * step * GROWTH)).all():
            break
        step *= 0.9
    return step


def named(n: Mapping[str, float]) -> dict[str, float]:
    """Constants of `usvauv.kernels.vehicles.numbers` by name, of a torpedo's numbers."""
    return {name: float(value) for name, value in zip(Constant.names, constants_of(n), strict=True)}


def top_speed(c: Mapping[str, float]) -> float:
    """Speed at which the drag is the thrust of the propeller at its limit and the lift, m/s; infinite without drag."""
    n, drag = c["propeller_limit"], c["axial_drag"]
    slope, force = c["thrust_slope"] * n, c["thrust_0"] * n * n + GRAVITY * abs(c["displaced"])
    if drag > 0:
        return (slope + math.sqrt(slope * slope + 4 * drag * force)) / (2 * drag)
    return -force / slope if slope < 0 else math.inf


def motions(c: Mapping[str, float], u: float, across: float, damping: float, fins: float) -> list[np.ndarray]:
    """Matrices of the linearised motion: of (v, p, r, roll) and of (u, w, q, pitch).

    Args:
        c: constants of `usvauv.kernels.vehicles.numbers` by name.
        u, across: speeds ahead and across with which forces grow, m/s.
        damping, fins: factors on damping and on the forces of the fins, over that on the mass.
    """
    arm, half, place, tail = c["mass"] * c["weight_below"], c["half_length"], c["hull_lift_place"], c["fin_place"]
    ahead, slender = (c["mass"] + c["added_surge"]) * u, (c["added_sway"] - c["added_surge"]) * u
    lift = damping * c["hull_lift"] * u
    flow = damping * (c["linear_sway"] + (2 * c["cross_drag"] + 0.5 * c["hull_induced"]) * across)
    spin = damping * (c["linear_turn"] + 2 / 3 * c["cross_drag"] * half * half * across)
    rudder, stern = (
        fins * c[f"{fin}_area"] * (slope * u + (4 + 0.25 * c["fin_induced"] * slope * slope) * across)
        for fin in ("rudder", "stern")
        for slope in (c[f"{fin}_lift"],)
    )
    # Rows Y, K, N, and X, Z, M.
    aside = np.zeros((3, 4))
    aside[0, [0, 2]] = -lift - flow - rudder, -place * lift - tail * rudder - ahead
    aside[1, 1:] = -damping * c["linear_roll"], arm * u, -arm * GRAVITY
    aside[2, [0, 2]] = -place * lift - tail * rudder - slender, -(place**2) * lift - tail**2 * rudder - spin
    upright = np.zeros((3, 4))
    upright[0, 0] = -damping * 2 * c["axial_drag"] * u + min(c["thrust_slope"], 0.0) * c["propeller_limit"]
    upright[1, 1:3] = -lift - flow - stern, place * lift + tail * stern + ahead
    upright[2, 1:] = (
        place * lift + tail * stern + slender,
        -(place**2) * lift - tail**2 * stern - spin,
        -arm * GRAVITY,
    )
    lateral, vertical = np.zeros((2, 4, 4))
    lateral[:3, :3] = [[c["vp_vv"], c["vp_vp"], 0], [c["vp_vp"], c["vp_pp"], 0], [0, 0, c["yaw"]]]
    vertical[:3, :3] = [[c["uq_uu"], 0, c["uq_uq"]], [0, c["heave"], 0], [c["uq_uq"], 0, c["uq_qq"]]]
    lateral, vertical = lateral[:, :3] @ aside, vertical[:, :3] @ upright
    lateral[3, 1] = vertical[3, 2] = 1.0
    return [lateral, vertical]


def spins(c: Mapping[str, float]) -> bool:
    """Whether the propeller's torque at the fastest commanded speed is more than a torpedo's keel holds."""
    slope = c["thrust_slope"] * FASTEST
    thrust = 4 * c["thrust_0"] * c["axial_drag"] * FASTEST**2
    n = min((math.sqrt(slope * slope + thrust) - slope) / (2 * c["thrust_0"]), c["propeller_limit"])
    torque = abs(c["torque_0"] * n * n + c["torque_slope"] * n * FASTEST)
    return torque > c["mass"] * GRAVITY * c["weight_below"]


def torpedo_substep(n: Mapping[str, float], variation: float, longest: float) -> float:
    """The longest stable substep of a torpedo and its autopilot up to `longest`, s; below `SHORTEST` if there is none.

    Forces are those at the speed of full thrust, at least at the fastest that a mission commands.

    Args:
        n: its numbers by name.
        variation: share by which mass, drag and fins may differ.
    """
    c = named(n)
    fastest = min(max(top_speed(c), FASTEST), MOST)
    factors = sorted({(1 - variation) / (1 + variation), (1 + variation) / (1 - variation)})
    found = [
        matrix
        for ahead in (0.0, fastest)
        for across in (0.0, DRIFT * fastest)
        for damping, fins in itertools.product(factors, factors)
        for matrix in motions(c, ahead, across, damping, fins)
    ]
    lengths = max(FASTEST, n["slowest"]) / n["length"]
    loops = max((1 + 2 * n[f"{loop}_damping"]) * n[f"{loop}_frequency"] for loop in ("heading", "pitch"))
    sampled = 1.0 / max(loops * lengths * factors[-1], n["speed_frequency"])
    return stable(np.linalg.eigvals(np.array(found)), min(longest, sampled), SHORTEST)


def substep(n: Mapping[str, float], variation: float) -> float:
    """The longest substep, s, of `Vehicle.substep`.

    Raises:
        ValueError: the numbers move it too fast for any substep; the message names one.
    """

    def longest(numbers: Mapping[str, float]) -> float:
        hull = numbers["length"] > numbers["diameter"]
        return torpedo_substep(numbers, variation, SUBSTEP) if hull else 0.0

    shortest = SHORTEST
    return admitted(n, USUAL, longest, shortest, f"moves too fast for substeps of {1e3 * shortest:g} ms")


def check_roll(n: Mapping[str, float]) -> None:
    """Refuse a torpedo whose propeller spins the hull.

    Raises:
        ValueError: it does; the message names a number.
    """

    def rights(numbers: Mapping[str, float]) -> float:
        return float(numbers["length"] > numbers["diameter"] and not spins(named(numbers)))

    admitted(n, USUAL, rights, 1.0, "the propeller's torque spins the hull")
