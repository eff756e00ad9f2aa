"""A torpedo-shaped vehicle in NumPy and double precision, written from the equations in another form than the kernels.

State: place x, rotation matrix R, impulse P and angular impulse H of body and water in the frame of reference, angles
of the fins, revolutions. With the inertias turned into that frame, A the added masses, m_f the displaced water's mass:

    P = m (ẋ + ω × r_G) + A (ẋ − V),   H = (I + I_A) ω + m r_G × ẋ,
    Ṗ = F + m_f DV/Dt + (m − m_f) g − Gᵀ A (ẋ − V),   Ḣ = N + m r_G × g − m ẋ × (ω × r_G) − (ẋ − V) × A (ẋ − V).

Drag of the cross-flow is a numerical quadrature along the hull in the water's velocity there, lift and drag come from
angles of attack, added masses from Lamb's integrals. All arrays may have any leading axes.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import quad, solve_ivp

GRAVITY = np.array([0.0, 0.0, 9.81])
NODES, WEIGHTS = np.polynomial.legendre.leggauss(3)


@dataclass
class Water:
    """Velocity V + G x + rate t, at x from where the vehicle begins, north, east, down."""

    velocity: np.ndarray = field(default_factory=lambda: np.zeros(3))
    gradient: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    rate: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def at(self, x: np.ndarray, t: float) -> np.ndarray:
        return self.velocity + x @ self.gradient.T + self.rate * t


def lamb(length: float, diameter: float) -> tuple[float, float, float]:
    """k1, k2, k' of a prolate spheroid by Lamb's integrals (§114, §115)."""
    a, b = length / 2, diameter / 2

    def integral(axis: float) -> float:
        # λ = a² tan² s maps the half line to a finite one
        def slope(s: float) -> float:
            lam = a * a * math.tan(s) ** 2
            return (
                2
                * a
                * a
                * math.tan(s)
                / math.cos(s) ** 2
                / ((axis * axis + lam) * (b * b + lam) * (a * a + lam) ** 0.5)
            )

        return a * b * b * quad(slope, 0, math.pi / 2, limit=500)[0]

    alpha, beta = integral(a), integral(b)
    difference = a * a - b * b
    turn = difference**2 * (beta - alpha) / (2 * difference - (a * a + b * b) * (beta - alpha)) / (a * a + b * b)
    return alpha / (2 - alpha), beta / (2 - beta), turn


def skew(a: np.ndarray) -> np.ndarray:
    """The matrix of a ×."""
    out = np.zeros((*a.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -a[..., 2], a[..., 1], -a[..., 0]
    return out - np.swapaxes(out, -1, -2)


def attached(angle: np.ndarray, stall: float) -> np.ndarray:
    return 1 / (1 + (np.sin(angle) / math.sin(stall)) ** 4)


class Reference:
    """A vehicle with some numbers (all of `numbers.NUMBERS`) in some water, told its actuators."""

    def __init__(self, numbers: dict[str, float], water: Water | None = None, told=(0.0, 0.0, 0.0)) -> None:
        self.n, self.water, self.told = numbers, water or Water(), np.asarray(told, float)
        n = numbers
        k1, k2, turn = lamb(n["length"], n["diameter"])
        m, a, b = n["mass"], n["length"] / 2, n["diameter"] / 2
        self.centre = np.array([0, 0, n["weight_below"]])
        hull = m / 5 * np.diag([2 * b * b, a * a + b * b, a * a + b * b])
        self.added = m * np.diag([k1, k2, k2])
        self.inertia = hull - m * skew(self.centre) @ skew(self.centre)
        self.added_inertia = hull @ np.diag([n["roll_added"], turn, turn])
        self.displaced = m + n["buoyancy"] / GRAVITY[2]
        self.mass_matrix = np.block(
            [
                [m * np.eye(3) + self.added, -m * skew(self.centre)],
                [m * skew(self.centre), self.inertia + self.added_inertia],
            ]
        )

    # packing: x 3, R 9, P 3, H 3, rudder, stern, propeller
    def start(self, x, R, v, omega, actuators) -> np.ndarray:
        """State from place, attitude, velocity through the water and angular velocity in the body's axes, actuators."""
        x, R, v, omega = (np.asarray(part, float) for part in (x, R, v, omega))
        V = self.water.at(x, 0.0)
        absolute = np.concatenate([v + np.einsum("...ji,...j->...i", R, V), omega], -1)
        impulse = np.einsum("ij,...j->...i", self.mass_matrix, absolute)
        impulse[..., :3] -= (absolute[..., :3] - v) @ self.added
        P, H = (np.einsum("...ij,...j->...i", R, part) for part in (impulse[..., :3], impulse[..., 3:]))
        return np.concatenate([x, R.reshape(*R.shape[:-2], 9), P, H, np.broadcast_to(actuators, x.shape)], -1)

    def motion(self, state: np.ndarray, t: float):
        """Place, R, velocity through the water and angular velocity in the body's axes, actuators, the water's V."""
        x, R = state[..., :3], state[..., 3:12].reshape(*state.shape[:-1], 3, 3)
        P, H = (np.einsum("...ji,...j->...i", R, state[..., at : at + 3]) for at in (12, 15))
        V = self.water.at(x, t)
        carried = np.einsum("...ji,...j->...i", R, V)
        P = P + carried @ self.added
        absolute = np.linalg.solve(self.mass_matrix, np.concatenate([P, H], -1)[..., None])[..., 0]
        return x, R, absolute[..., :3] - carried, absolute[..., 3:], state[..., 18:], V

    def cross_flow(self, ends: np.ndarray):
        """−ρ/2 C_d D ∫ |v| v ds and its first moment, for a velocity across that is linear between its two ends."""
        a = self.n["length"] / 2
        aft, fore = ends[..., 0], ends[..., 1]
        with np.errstate(divide="ignore", invalid="ignore"):
            turn = np.where(aft * fore < 0, -a + 2 * a * aft / (aft - fore), 0.0)[..., None]
        force = moment = 0.0
        for low, high in ((-a, turn), (turn, a)):
            s = low + (high - low) * (NODES + 1) / 2
            v = aft[..., None] + (fore - aft)[..., None] * (s + a) / (2 * a)
            part = WEIGHTS * (high - low) / 2 * np.abs(v) * v
            force, moment = force + part.sum(-1), moment + (s * part).sum(-1)
        scale = -0.5 * self.n["density"] * self.n["cross_drag"] * self.n["diameter"]
        return scale * force, scale * moment

    def fin(self, area: float, slope: float, angle: np.ndarray, u: np.ndarray, v: np.ndarray):
        """Force ahead and across of a pair of fins."""
        n = self.n
        U2, drift = u * u + v * v, np.arctan2(v, u)
        attack = angle + drift
        s = attached(attack, n["fin_stall"])
        wing = slope * np.sin(attack) * np.cos(attack)
        lift = s * wing + (1 - s) * 2 * np.abs(np.sin(attack)) * np.sin(attack) * np.cos(attack)
        drag = s * wing**2 / (math.pi * 0.7 * n["fin_aspect"]) + (1 - s) * 2 * np.abs(np.sin(attack)) ** 3
        pressure = 0.5 * n["density"] * area * U2
        return (
            pressure * (lift * np.sin(drift) - drag * np.cos(drift)),
            -pressure * (lift * np.cos(drift) + drag * np.sin(drift)),
        )

    def propeller(self, rps: np.ndarray, u: np.ndarray):
        """Thrust and torque."""
        n = self.n
        J = np.where(rps > 0, np.maximum(u, 0) * (1 - n["wake"]) / (np.maximum(rps, 1e-9) * n["propeller_diameter"]), 0)
        K_T, K_Q = (n[k + "_0"] + (n[k + "_1"] - n[k + "_0"]) * J / n["advance"] for k in ("thrust", "torque"))
        dynamic = n["density"] * rps * np.abs(rps) * n["propeller_diameter"] ** 4
        return dynamic * K_T * (1 - n["thrust_deduction"]), dynamic * n["propeller_diameter"] * K_Q

    def power(self, rps: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Electrical power, W."""
        return 2 * math.pi * rps * self.propeller(rps, u)[1] / self.n["efficiency"] + self.n["hotel"]

    def forces(self, R, v, omega, actuators) -> np.ndarray:
        """Damping, fins and propeller in the body's axes, (…, 6)."""
        n = self.n
        G = np.einsum("...ki,kl,...lj->...ij", R, self.water.gradient, R)

        def local(s: float) -> np.ndarray:
            """Velocity of the hull's point (s, 0, 0) through the water there."""
            point = np.array([s, 0.0, 0.0])
            return v + np.cross(omega, point) - G @ point

        a = n["length"] / 2
        ends = np.stack([local(-a), local(a)], -1)
        spin = omega - 0.5 * np.stack(
            [G[..., 2, 1] - G[..., 1, 2], G[..., 0, 2] - G[..., 2, 0], G[..., 1, 0] - G[..., 0, 1]], -1
        )
        lean = (ends[..., 1] - ends[..., 0]) / (2 * a)  # r' and −q' in its components 1 and 2
        u = v[..., 0]
        sway, sway_moment = self.cross_flow(ends[..., 1, :])
        heave, heave_moment = self.cross_flow(ends[..., 2, :])

        # the hull as a wing in the plane of its drift
        wing = local(n["hull_lift_place"])
        wing = np.concatenate([u[..., None], wing[..., 1:]], -1)
        across = np.hypot(wing[..., 1], wing[..., 2])
        attack = np.arctan2(across, u)
        U2 = u * u + across**2
        toward = wing[..., 1:] / np.maximum(across, 1e-300)[..., None]
        s = attached(attack, n["hull_stall"])
        C = n["hull_lift"] * s * np.sin(attack) * np.cos(attack)
        pressure = 0.5 * n["density"] * n["diameter"] ** 2 * U2
        lift, drag = pressure * C, pressure * C**2 / (math.pi * 0.7)
        hull_x = lift * np.sin(attack) - drag * np.cos(attack)
        hull_across = -(lift * np.cos(attack) + drag * np.sin(attack))[..., None] * toward

        tail = local(n["fin_place"])
        rudder_x, rudder_y = self.fin(n["rudder_area"], n["rudder_lift"], actuators[..., 0], u, tail[..., 1])
        stern_x, stern_z = self.fin(n["stern_area"], n["stern_lift"], actuators[..., 1], u, tail[..., 2])
        thrust, torque = self.propeller(actuators[..., 2], u)
        M = np.diag(self.mass_matrix)
        righting = n["mass"] * GRAVITY[2] * n["weight_below"]
        return np.stack(
            [
                hull_x
                - 0.5 * n["density"] * math.pi / 4 * n["diameter"] ** 2 * n["axial_drag"] * np.abs(u) * u
                + rudder_x
                + stern_x
                + thrust,
                hull_across[..., 0] + sway - M[1] / n["sway_time"] * v[..., 1] + rudder_y,
                hull_across[..., 1] + heave - M[2] / n["sway_time"] * v[..., 2] + stern_z,
                -2 * n["roll_damping"] * math.sqrt(righting * M[3]) * spin[..., 0] - torque,
                -n["hull_lift_place"] * hull_across[..., 1]
                - heave_moment
                + M[4] / n["turn_time"] * lean[..., 2]
                - n["fin_place"] * stern_z,
                n["hull_lift_place"] * hull_across[..., 0]
                + sway_moment
                - M[4] / n["turn_time"] * lean[..., 1]
                + n["fin_place"] * rudder_y,
            ],
            -1,
        )

    def slope(self, t: float, flat: np.ndarray) -> np.ndarray:
        """Time derivative of the state."""
        n, water = self.n, self.water
        state = flat.reshape(-1, 21)
        _, R, v, omega, actuators, V = self.motion(state, t)
        wrench = self.forces(R, v, omega, actuators)

        def turned(part: np.ndarray) -> np.ndarray:
            return np.einsum("...ij,...j->...i", R, part)

        F, N, spin, drift, impulse = (
            turned(part) for part in (wrench[..., :3], wrench[..., 3:], omega, v, v @ self.added)
        )
        arm, material = turned(np.broadcast_to(self.centre, v.shape)), water.rate + V @ water.gradient.T
        m, place = n["mass"], drift + V
        dP = F + self.displaced * material + (m - self.displaced) * GRAVITY - impulse @ water.gradient
        dH = N + m * np.cross(arm, GRAVITY) - m * np.cross(place, np.cross(spin, arm)) - np.cross(drift, impulse)
        lags = np.array([n["fin_lag"], n["fin_lag"], n["propeller_lag"]])
        most = np.array([n["fin_rate"], n["fin_rate"], np.inf])
        limits = np.array([n["fin_limit"], n["fin_limit"], n["propeller_limit"]])
        moved = np.clip((np.clip(self.told, -limits, limits) - actuators) / lags, -most, most)
        dR = (R @ skew(omega)).reshape(-1, 9)
        return np.concatenate([place, dR, dP, dH, moved], -1).reshape(flat.shape)

    def fly(self, state: np.ndarray, seconds: float, rtol: float = 1e-9) -> np.ndarray:
        """The state after a time, by an embedded Runge–Kutta method of order 8."""
        found = solve_ivp(self.slope, (0, seconds), state.ravel(), "DOP853", rtol=rtol, atol=1e-11, t_eval=[seconds])
        return found.y[:, -1].reshape(state.shape)
