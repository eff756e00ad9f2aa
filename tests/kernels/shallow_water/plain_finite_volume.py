"""The nonlinear scheme once more, in NumPy and f64, whole fields at a time, from what the docstrings say of it."""

import math
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np

from usvauv.kernels.shallow_water.finite_volume import COURANT, ROUGH, SHORE
from usvauv.kernels.shallow_water.nonlinear import FIRST_STEP, NonlinearShallowWater
from usvauv.kernels.shallow_water.riemann import SMOOTH

Fields = tuple[np.ndarray, np.ndarray, np.ndarray]


def limited(below: np.ndarray, above: np.ndarray, theta: np.ndarray | float) -> np.ndarray:
    """Half slope: a quarter of both differences, at most theta times the smaller, 0 where they differ in sign."""
    least = np.minimum(theta * np.minimum(abs(below), abs(above)), abs(below + above) / 4)
    return np.where(below * above > 0, np.sign(below) * least, 0.0)


def quotient(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a/b, 0 where b is."""
    return np.divide(a, b, out=np.zeros(np.broadcast(a, b).shape), where=np.broadcast_to(b != 0, np.shape(a)))


class PlainFiniteVolumes:
    """The scheme of a solver; `kind` by side, and the prescribed elevation at a time.

    Attributes:
        D, u, v: water over that of the still sea (m) and velocities (m/s), (ny, nx).
        steps: taken.
    """

    def __init__(
        self, solver: NonlinearShallowWater, kind: dict[str, str], start: Fields, tide: Callable[[float], float]
    ) -> None:
        self.s, self.kind, self.tide, self.steps = solver, kind, tide, 0
        self.b = np.pad(solver.bed, 2, mode="symmetric")
        eta, u, v = (np.asarray(field, np.float64) for field in start)
        wet = eta > solver.bed
        sea = np.maximum(-solver.bed, 0)
        self.D = np.where(wet, eta - np.maximum(solver.bed, 0), -sea)
        self.u, self.v = np.where(wet, u, 0), np.where(wet, v, 0)
        speed = np.maximum(abs(self.u), abs(self.v)) + np.sqrt(solver.gravity * (self.D + sea))
        self.fastest = FIRST_STEP * speed.max() / min(solver.dx, solver.dy)

    def advance(self) -> None:
        """One interval: half a step along x, one along y, half a step along x, the latter together with the next."""
        interval, begun, done, before = self.s.interval, self.s.time, 0.0, 0.0
        while done < interval:
            done += before
            left = interval - done
            dt = left / max(math.ceil(left * self.fastest / COURANT), 1) if left > 1e-9 * interval else 0.0
            done = done if dt else interval
            if dt:
                self.fastest, self.steps = 0.0, self.steps + 1
            self._sweep(0, (before + dt) / 2, self.tide(begun + done - before / 2), self.tide(begun + done + dt / 2))
            if dt:
                self._rub(dt / 2)
                self._sweep(1, dt, self.tide(begun + done), self.tide(begun + done + dt))
                self._rub(dt / 2)
            before = dt

    def _rub(self, t: float) -> None:
        s = self.s
        h = np.maximum(self.D + np.maximum(-s.bed, 0), s.dry)
        time = -math.expm1(-s.drag * t) / s.drag if s.drag else t
        K = s.gravity * s.manning**2 / h ** (4 / 3)
        factor = math.exp(-s.drag * t) / (1 + K * time * np.hypot(self.u, self.v))
        self.u, self.v = self.u * factor, self.v * factor

    def _sweep(self, axis: int, dt: float, level: float, later: float) -> None:
        """A step along an axis, which is the last one of the arrays here; u is the velocity along it."""
        turned = (lambda field: field.T) if axis else (lambda field: field)
        g, dry, r = self.s.gravity, self.s.dry, dt / (self.s.dy if axis else self.s.dx)
        b = turned(self.b)[2:-2]
        fields = tuple(turned(field) for field in (self.D, *((self.v, self.u) if axis else (self.u, self.v))))
        ends = ("south", "north") if axis else ("west", "east")
        low = self._ghosts(ends[0], tuple(field[:, :2] for field in fields), b[:, :4], r, level, later, -1)
        mirrored = tuple(field[:, :-3:-1] for field in fields)
        high = self._ghosts(ends[1], mirrored, b[:, :-5:-1], r, level, later, 1)
        D, u, v = (
            np.concatenate([first, field, last[:, ::-1]], axis=1)
            for first, field, last in zip(low, fields, high, strict=True)
        )
        h, eta = D + np.maximum(-b, 0), D + np.maximum(b, 0)

        def here(field: np.ndarray) -> np.ndarray:
            return field[:, 1:-1]

        def slope(field: np.ndarray, theta: np.ndarray | float) -> np.ndarray:
            change = np.diff(field, axis=1)
            return limited(change[:, :-1], change[:, 1:], theta)

        def three(field: np.ndarray) -> tuple[np.ndarray, ...]:
            return field[:, :-2], field[:, 1:-1], field[:, 2:]

        # Half slopes and half a step, in all cells but the outermost ghosts.
        flooded = np.minimum.reduce(three(eta)) > np.maximum.reduce(three(b)) + dry
        courant = np.minimum(r * (abs(here(u)) + np.sqrt(g * here(h))), 1)
        theta = np.where(flooded, 1 / np.maximum(courant, 1 - courant), 0.5)
        slope_eta, slope_b = np.where(here(h) > dry, slope(eta, theta), 0), slope(b, theta)
        slope_u, slope_v = flooded * slope(u, theta), flooded * slope(v, 1.0)
        slope_h = np.clip(slope_eta - slope_b, -here(h), here(h))
        below, _, above = three(b)
        bend = np.clip(above + below - 2 * here(b), 0, SMOOTH * here(h)) / 2
        ahead = np.maximum(here(eta) + slope_eta - np.maximum(here(b) + slope_b, above - slope_b - bend), 0)
        behind = np.maximum(here(eta) - slope_eta - np.maximum(here(b) - slope_b, below + slope_b - bend), 0)
        passage = np.minimum((ahead + behind) / 2, here(h))
        widening = np.clip((ahead - behind) / 2, -here(h), here(h))
        change_h = -r * (here(u) * widening + passage * slope_u)
        change_u = -r * (here(u) * slope_u + g * slope_eta * quotient(passage, here(h)))
        change_v = -r * here(u) * slope_v

        def side(sign: int) -> SimpleNamespace:
            """States at the upper or lower faces, and how much may leave through them."""
            fast = here(u) ** 2 > g * here(h)
            part = np.where(fast, sign * here(u) > 0, 0.5)
            return SimpleNamespace(
                eta=here(eta) + change_h + sign * slope_eta,
                h=here(h) + change_h + sign * slope_h,
                u=here(u) + change_u + sign * slope_u,
                v=here(v) + change_v + sign * slope_v,
                most=part * here(h) / r,
            )

        upper, lower = side(1), side(-1)
        left = SimpleNamespace(**{name: field[:, :-1] for name, field in vars(upper).items()})
        right = SimpleNamespace(**{name: field[:, 1:] for name, field in vars(lower).items()})
        flux = riemann(left, right, g)
        both = flooded[:, :-1] & flooded[:, 1:]
        rate = flux.speed * np.where(both, 1 + ROUGH * flux.step, SHORE)
        self.fastest = max(self.fastest, rate.max() * r / dt)

        inner = np.s_[:, 1:-1]
        still = np.maximum(-b[:, 2:-2], 0)
        h_new = np.maximum(fields[0] - r * np.diff(flux.mass, axis=1), -still) + still
        pull = 2 * g * ((passage + change_h) * slope_eta)[inner]
        q_u = h[:, 2:-2] * fields[1] - r * (flux.left[:, 1:] - flux.right[:, :-1] + pull)
        q_v = h[:, 2:-2] * fields[2] - r * np.diff(flux.transverse, axis=1)
        per_depth = quotient(2 * h_new, h_new**2 + np.maximum(h_new**2, dry**2))
        u_new, v_new = q_u * per_depth, q_v * per_depth
        self.D = turned(h_new - still)
        self.u, self.v = (turned(v_new), turned(u_new)) if axis else (u_new, v_new)

    def _ghosts(
        self, side: str, inside: Fields, b: np.ndarray, r: float, level: float, later: float, outward: int
    ) -> Fields:
        """Two ghosts, the outer one first, from the two cells inside (…, 2), the outer one first; bed b of all four."""
        D, u, v = (field.copy() for field in inside)
        if self.kind[side] == "wall":
            return D[:, ::-1], -u[:, ::-1], v[:, ::-1]
        g, forced = self.s.gravity, self.kind[side] == "forced"
        eta_1, eta_2 = (D[:, n] + np.maximum(b[:, 2 + n], 0) for n in (0, 1))
        u_1, u_2 = (outward * u[:, n] for n in (0, 1))
        found = [np.zeros_like(D), np.zeros_like(u), np.repeat(v[:, :1], 2, axis=1)]
        for layer in (1, 2):
            own = b[:, 2 - layer]
            h0, land = np.maximum(-own, 0), np.maximum(own, 0)
            c0 = np.sqrt(g * h0)

            def rise(water: np.ndarray, c0=c0, h0=h0) -> np.ndarray:
                return np.sqrt(g * np.maximum(water + h0, 0)) - c0

            even = np.maximum(1 - quotient(abs(b[:, 2] - b[:, 3]), np.maximum(h0, self.s.dry)), 0)
            first = np.sqrt(g * np.maximum(D[:, 0] + np.maximum(-b[:, 2], 0), 0)) - np.sqrt(g * np.maximum(-b[:, 2], 0))
            flooded = np.minimum(eta_1, eta_2) > np.maximum(b[:, 2], b[:, 3]) + self.s.dry

            def invariant(way: np.ndarray, land=land, h0=h0, rise=rise, first=first, flooded=flooded) -> np.ndarray:
                surface = np.maximum(eta_1 + way * (eta_1 - eta_2) - land, -h0)
                return np.where(flooded, u_1 + way * (u_1 - u_2) + 2 * rise(surface), u_1 + 2 * first)

            leaving = invariant(even * layer)
            returning = invariant(-even * (layer - 1)) if forced else 0.0
            outside = np.zeros_like(h0)
            if self.kind[side] != "radiating":
                inwards = c0 - leaving / 4 - 0.75 * (returning - 4 * rise(np.maximum(level - land, -h0)))
                delay = (layer - 0.5) / np.maximum(r * inwards, 0.25)
                outside = np.maximum(level + delay * (later - level) - land, -h0)
            entering = returning - 4 * rise(outside)
            excess = np.maximum((leaving - entering) / 4, -c0)
            speed = (leaving + entering) / 2
            if forced:
                speed = np.clip(speed, -c0 - excess, c0 + excess)
            water = outside + ((c0 + excess) ** 2 - (c0 + rise(outside)) ** 2) / g
            found[0][:, 2 - layer] = np.maximum(water, -h0)
            found[1][:, 2 - layer] = outward * speed
        return tuple(found)


def riemann(left: SimpleNamespace, right: SimpleNamespace, g: float) -> SimpleNamespace:
    """HLLE flux of hydrostatically reconstructed states, in conservative form; forces less those of either side."""
    beds = left.eta - left.h, right.eta - right.h
    bed = np.maximum(*beds)
    d_L, d_R = np.maximum(left.eta - bed, 0), np.maximum(right.eta - bed, 0)
    c_L, c_R = np.sqrt(g * d_L), np.sqrt(g * d_R)
    u_mean, c_mean = quotient(c_L * left.u + c_R * right.u, c_L + c_R), np.sqrt(g * (d_L + d_R) / 2)
    s_L, s_R = np.minimum(left.u - c_L, u_mean - c_mean), np.maximum(right.u + c_R, u_mean + c_mean)
    s_L = np.where(d_R > 0, np.where(d_L > 0, s_L, right.u - 2 * c_R), left.u - c_L)
    s_R = np.where(d_L > 0, np.where(d_R > 0, s_R, left.u + 2 * c_L), right.u + c_R)
    s_L, s_R = np.minimum(s_L, 0), np.maximum(s_R, 0)

    def between(flow_L: np.ndarray, flow_R: np.ndarray, jump: np.ndarray) -> np.ndarray:
        return quotient(s_R * flow_L - s_L * flow_R + s_L * s_R * jump, s_R - s_L)

    q_L, q_R = d_L * left.u, d_R * right.u
    wanted = between(q_L, q_R, d_R - d_L)
    mass = np.clip(wanted, -right.most, left.most)
    upwind = np.where(mass > 0, left.u, right.u)
    # The force of the whole, ½ g h² of both sides between them, is that of the left side and what is beyond it.
    force = between(g * d_L**2 / 2, g * d_R**2 / 2, np.zeros_like(mass))
    moved = np.where(mass == wanted, between(q_L * left.u, q_R * right.u, q_R - q_L), mass * upwind)
    step = abs(beds[0] - beds[1])
    return SimpleNamespace(
        mass=mass,
        left=moved + force - g * d_L**2 / 2,
        right=moved + force - g * d_R**2 / 2,
        transverse=mass * np.where(mass > 0, left.v, right.v),
        speed=np.maximum(s_R, -s_L),
        step=quotient(step, step + np.maximum(d_L, d_R)),
    )
