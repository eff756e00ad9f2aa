"""The water around a vehicle at any depth: the sums of its parts in double precision, and differences of them."""

import math

import numpy as np
import pytest
import taichi as ti
import torch
from scipy.interpolate import RegularGridInterpolator

from usvauv.env.sea.water import AirySea
from usvauv.kernels.flow import airy, at_depth
from usvauv.kernels.flow.current import Profile, Water
from usvauv.kernels.flow.vortex import IMAGES, Eddies, current_and_gradient
from usvauv.kernels.functions import kernel
from usvauv.kernels.types import Level, array1, array2, array3, array4, index1, vec2, vec3

G, H, CRUISE, DECAY, STEP, SIDE = 9.81, 120.0, 100.0, 280.0, 1.0, 200.0
EDDIES = Eddies(period=300.0, centre=(100.0, 100.0))
NX = NY = 4


def some_waves() -> dict[str, np.ndarray]:
    random = np.random.default_rng(5)
    shape = 2, 20
    omega = random.uniform(0.3, 1.7, shape)
    a, direction, phase = random.uniform(0.1, 0.5, shape), random.uniform(-3, 3, shape), random.uniform(0, 6, shape)
    return {"amplitude": a, "omega": omega, "direction": direction, "phase": phase}


def orbital(waves: dict[str, np.ndarray], sea: int, place: np.ndarray, time: float) -> np.ndarray:
    """(u, v, w) at (x, y, z) by the formulas of `airy`, in double precision."""
    a, omega, direction, phase = (waves[name][sea] for name in ("amplitude", "omega", "direction", "phase"))
    k = airy.wavenumber(omega, H, G)
    kx, ky = k * np.cos(direction), k * np.sin(direction)
    theta = kx * place[0] + ky * place[1] - omega * time + phase
    C = np.cosh(k * (place[2] + H)) / np.sinh(k * H)
    D = np.sinh(k * (place[2] + H)) / np.sinh(k * H)
    along = a * omega * C * np.cos(theta) / k
    return np.array([(along * kx).sum(), (along * ky).sum(), (a * omega * D * np.sin(theta)).sum()])


@kernel
def sample(
    vortices: array3,
    stream: array4,
    bed: array4,
    still: array4,
    sea: index1,
    wave: airy.waves,
    since: array1,
    shear: ti.f32,
    points: array2,
    out: array3,
):
    for n in range(points.shape[0]):
        water = ti.static(
            Water(
                *(vortices, stream, SIDE, SIDE, bed, still, still, still, 1.0, 1.0, NX, NY),
                *(sea, wave, since),
                pattern=EDDIES.pattern,
                profile=Profile(CRUISE, DECAY, shear, H),
            )
        )
        x, y, depth = points[n, 0], points[n, 1], points[n, 2]
        u, v, u_x, u_y, v_x = current_and_gradient(vortices, 0, x, y, water.pattern)
        found = at_depth.around(water, 0, x, y, depth, vec2(u, v), vec3(u_x, u_y, v_x))
        for i in ti.static(range(3)):
            out[n, i, 0] = found.velocity[i]
            out[n, i, 4] = found.rate[i]
            for j in ti.static(range(3)):
                out[n, i, 1 + j] = found.gradient[i, j]


class Scene:
    """A sea, two vortices and a sheared real current, and the kernel's account of it."""

    def __init__(self, device: torch.device) -> None:
        self.device = device
        self.waves = some_waves()
        self.sea = AirySea(**self.waves, depth=H, gravity=G, levels=(0.0, -CRUISE), step=STEP)
        self.vortices = torch.tensor([[[60.0, 80.0, 200.0, 20.0], [150.0, 120.0, -150.0, 25.0]]], device=device)
        self.stream = np.random.default_rng(1).normal(size=(len(Level.names), 3, 4, 2)) * 0.3

    def real(self, place: np.ndarray) -> np.ndarray:
        share = min(-place[2] / CRUISE, 1.0)
        field = self.stream[0] + share * (self.stream[1] - self.stream[0])
        rows, columns = (np.linspace(0, SIDE, count) for count in field.shape[:2])
        return np.array([*RegularGridInterpolator((rows, columns), field)(place[1::-1])[0], 0.0])

    def vortex(self, place: np.ndarray) -> np.ndarray:
        """By the complex form in `usvauv.kernels.flow.vortex`, in double precision."""
        flow, L = 0j, EDDIES.period
        for x, y, Gamma, delta in self.vortices[0].tolist():
            z = complex(place[0] - x, place[1] - y)
            z -= L * complex(round(z.real / L), round(z.imag / L))
            zeta = -np.expm1(-(abs(z) ** 2) / delta**2) / z
            zeta -= sum(c * z ** (4 * k - 1) / L ** (4 * k) for k, c in enumerate(IMAGES, 1))
            flow += Gamma / (2j * math.pi) * (zeta - math.pi * z.conjugate() / L**2)
        return np.array([flow.real, -flow.imag, 0.0]) * math.exp(place[2] / DECAY)

    def velocity(self, place: np.ndarray, time: float) -> np.ndarray:
        return orbital(self.waves, 1, place, time) + self.vortex(place) + self.real(place)

    def computed(self, places: np.ndarray, time: float, shear: float = 0.0) -> np.ndarray:
        """(P, 3, 5): velocity, gradient, rate."""
        self.sea.set_time(time)
        still = torch.zeros((1, NY + 1, NX + 1, 8), device=self.device)
        bed = torch.full((1, 2, 2, 1), H, device=self.device)
        stream = torch.tensor(self.stream, dtype=torch.float32, device=self.device)
        index = torch.tensor([1], dtype=torch.int32, device=self.device)
        points = torch.tensor(places * [1, 1, -1], dtype=torch.float32, device=self.device)
        out = torch.zeros((len(places), 3, 5), device=self.device)
        sample(self.vortices, stream, bed, still, index, self.sea.wave, self.sea.since, shear, points, out)
        return out.double().cpu().numpy()


@pytest.fixture(scope="module")
def scene(device) -> Scene:
    return Scene(device)


PLACES = np.array([[40, 70, -1], [40, 70, -30], [120, 130, -99], [90, 20, -110], [61, 80.5, -80], [5, 190, -80.0]])


def test_velocity(scene):
    found = scene.computed(PLACES, 7.0)
    for place, part in zip(PLACES, found, strict=True):
        np.testing.assert_allclose(part[:, 0], scene.velocity(place, 7.0), atol=2e-5)


def test_gradient(scene):
    """Beside central differences of velocities in double precision, so near that these are exact to 1e-7."""
    found, h = scene.computed(PLACES, 7.0), 1e-3
    for place, part in zip(PLACES, found, strict=True):
        for axis in range(3):
            step = h * np.eye(3)[axis]
            slope = (scene.velocity(place + step, 7.0) - scene.velocity(place - step, 7.0)) / (2 * h)
            np.testing.assert_allclose(part[:, 1 + axis], slope, atol=2e-6, err_msg=f"{place} {axis}")


def test_a_sheared_current_goes_with_the_height_over_the_bed(device):
    """V (1 − d/h)^n between, above and below the two levels of its grid, and its vertical gradient."""
    scene, n, surface = Scene(device), 1 / 7, np.array([0.6, -0.3])
    scene.vortices[..., 2] *= 0.0
    scene.stream *= 0.0
    still = scene.computed(PLACES, 7.0, n)
    scene.stream += (surface * [[1.0], [(1 - CRUISE / H) ** n]])[:, None, None]
    found = scene.computed(PLACES, 7.0, n) - still
    relative = 1 + PLACES[:, 2:] / H
    np.testing.assert_allclose(found[:, :2, 0], surface * relative**n, atol=1e-5)
    np.testing.assert_allclose(found[:, :2, 3], surface * n * relative ** (n - 1) / H, atol=1e-5)


def test_the_storm_has_no_divergence_and_no_rotation(scene):
    scene.vortices[..., 2] *= 0.0
    stream, scene.stream = scene.stream, np.zeros_like(scene.stream)
    gradient = scene.computed(PLACES, 3.0)[:, :, 1:4]
    scene.stream = stream
    scene.vortices[0, :, 2] = torch.tensor([200.0, -150.0])
    np.testing.assert_allclose(gradient, gradient.swapaxes(1, 2), atol=1e-6)
    np.testing.assert_allclose(np.trace(gradient, axis1=1, axis2=2), 0.0, atol=1e-6)


def test_with_its_rate_the_storm_is_exact_at_the_end_of_a_step(scene):
    found = scene.computed(PLACES, 7.0)
    for place, part in zip(PLACES, found, strict=True):
        change = orbital(scene.waves, 1, place, 7.0 + STEP) - orbital(scene.waves, 1, place, 7.0)
        np.testing.assert_allclose(part[:, 4] * STEP, change, atol=2e-5)
