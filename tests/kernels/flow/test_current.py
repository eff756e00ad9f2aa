"""The water's motion without the storm against NumPy and SciPy, in an oblong area with unequal numbers of nodes."""

import math

import numpy as np
import pytest
import taichi as ti
import torch
from scipy.interpolate import RegularGridInterpolator

from tests.cases.case import order
from tests.cases.plain import centres, many
from usvauv.kernels.flow import current
from usvauv.kernels.flow.vortex import ENDLESS, Eddies, sample_current
from usvauv.kernels.shallow_water.discretisation import Packing
from usvauv.kernels.shallow_water.linear import ShallowWater
from usvauv.kernels.types import Level

SIZE = (240.0, 130.0)
NX, NY = 21, 7
NUM_VORTICES = 3


def between(field: np.ndarray, at: np.ndarray, places) -> np.ndarray:
    """A field (rows, columns) whose nodes lie at `at`, bilinear between and beyond them, at places (P, 2)."""
    return RegularGridInterpolator(at, field, bounds_error=False, fill_value=None)(places[:, ::-1])


def rows_and_columns(shape) -> tuple[np.ndarray, np.ndarray]:
    """Places of nodes whose corners are the area's."""
    return np.linspace(0, SIZE[1], shape[0]), np.linspace(0, SIZE[0], shape[1])


class Sample:
    """Random water in two worlds, which sail on other seas of a pool; the bed is dry in a corner."""

    def __init__(self, device, num_seas: int, levels: int = 2, eddies: Eddies = ENDLESS) -> None:
        self.eddies = eddies
        draw = np.random.default_rng(num_seas)
        self.stream = draw.normal(size=(levels, 4, 6, 2))
        self.bed = draw.uniform(2, 9, (1, 5, 3, 1))
        self.bed[0, -1, -1] = -3.0
        self.vortices = np.empty((2, NUM_VORTICES, 4))
        self.vortices[..., :2] = draw.uniform(0, 200, (2, NUM_VORTICES, 2))
        self.vortices[..., 2:] = draw.uniform(20, 60, (2, NUM_VORTICES, 2))
        self.transports = draw.normal(size=(2, num_seas, NY + 1, NX + 1))
        self.units = (3.0, 0.7)
        self.sea_index = np.array([num_seas - 1, 0], np.int32)
        packing = Packing(num_seas, NX, NY)
        packed = torch.zeros(2, packing.blocks, NY + 1, packing.columns, 16)
        for field, plain in zip(packed, self.transports, strict=True):
            packing.pack(plain, field, 0)
        self.device, self.packed = device, packed.to(device)

    def put(self, numbers: np.ndarray) -> torch.Tensor:
        return torch.as_tensor(numbers, dtype=torch.float32, device=self.device)

    def grid(self, rows: int, columns: int, margin: float) -> np.ndarray:
        flow = torch.full((2, rows, columns, 2), math.nan, device=self.device)
        current.on_grid(
            self.put(np.array(SIZE)),
            self.put(self.vortices),
            self.put(self.stream),
            self.put(self.bed),
            *self.packed,
            *self.units,
            NX,
            NY,
            torch.as_tensor(self.sea_index, device=self.device),
            margin,
            flow,
            *self.eddies.pattern,
        )
        return flow.double().cpu().numpy()

    def without_waves(self, world: int, level: int, places: np.ndarray) -> np.ndarray:
        """Velocity (P, 2) of vortices and stream; beyond the area the stream is that of its edge."""
        vortices = self.put(self.vortices[world : world + 1])
        eddies = sample_current(vortices, self.put(places)[None], self.eddies.period)[0]
        eddies *= self.eddies.cruise if level == Level.cruise else 1.0
        inside = np.clip(places, 0, SIZE)
        stream = [between(self.stream[level, ..., axis], rows_and_columns((4, 6)), inside) for axis in range(2)]
        return eddies.double().cpu().numpy() + np.stack(stream, axis=-1)

    def long_waves(self, world: int, places: np.ndarray) -> np.ndarray:
        U, V = self.transports[:, self.sea_index[world]]
        dx, dy = SIZE[0] / NX, SIZE[1] / NY
        faces = np.arange(NX + 1) * dx, np.arange(NY + 1) * dy
        centres = (np.arange(NX) + 0.5) * dx, (np.arange(NY) + 0.5) * dy
        u = between(U[:NY], (centres[1], faces[0]), places)
        v = between(V[:, :NX], (faces[1], centres[0]), places)
        depth = np.maximum(between(self.bed[0, ..., 0], rows_and_columns((5, 3)), places), 1.0)
        return np.stack([self.units[0] * u, self.units[1] * v], axis=-1) / depth[:, None]


REPEATED = Eddies(700.0, (100.0, 100.0), 0.7)


@pytest.mark.parametrize(("margin", "eddies"), [(5.0, ENDLESS), (-30.0, REPEATED)])
@pytest.mark.parametrize("num_seas", [1, 18])
def test_on_a_grid(device, num_seas, margin, eddies):
    """Vortices, stream at cruise level and long waves, in strips of one sea and in two blocks of a pool.

    In the outer half cells waves go on as inside, and beyond the area they and the stream are as at its edge.
    """
    sample = Sample(device, num_seas, eddies=eddies)
    rows, columns = 12, 9
    flow = sample.grid(rows, columns, margin)
    x, y = (np.linspace(margin, side - margin, count) for side, count in zip(SIZE, (columns, rows), strict=True))
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    for world in range(2):
        expected = sample.without_waves(world, Level.cruise, places) + sample.long_waves(world, places.clip(0, SIZE))
        np.testing.assert_allclose(flow[world].reshape(-1, 2), expected, atol=2e-4)


@pytest.mark.parametrize(("level", "eddies"), [(Level.cruise, REPEATED), (Level.surface, REPEATED)])
def test_particle_paths(device, level, eddies):
    """Midpoint rule in double precision, also of particles that leave the area."""
    sample = Sample(device, 1, eddies=eddies)
    step, count = 2.0, 9
    starts = np.random.default_rng(0).uniform((0, 0), SIZE, (40, 2))
    starts[0] = SIZE
    paths = current.particle_paths(
        sample.put(sample.vortices[:1]),
        sample.put(sample.stream),
        sample.put(starts),
        level=level,
        size=SIZE,
        step=step,
        count=count,
        eddies=eddies,
    )
    assert paths.shape == (40, count + 1, 2)
    expected = [starts]
    for _ in range(count):
        middle = expected[-1] + step / 2 * sample.without_waves(0, level, expected[-1])
        expected.append(expected[-1] + step * sample.without_waves(0, level, middle))
    np.testing.assert_allclose(paths.double().cpu().numpy(), np.stack(expected, axis=1), atol=2e-3)
    assert (np.stack(expected) > SIZE).any()
    assert (np.stack(expected) < 0).any()


@ti.kernel
def sample_all(
    eta: ti.types.ndarray(dtype=ti.f32, ndim=4),
    points: ti.types.ndarray(dtype=ti.f32, ndim=2),
    found: ti.types.ndarray(dtype=ti.f32, ndim=3),
    dx: ti.f32,
    dy: ti.f32,
    nx: ti.i32,
    ny: ti.i32,
):
    for sea, p in ti.ndrange(found.shape[0], found.shape[1]):
        surface = current.long_wave_surface(eta, sea, points[p, 0], points[p, 1], dx, dy, nx, ny)
        for column in ti.static(range(3)):
            found[sea, p, column] = surface[column]


class TestSurface:
    X, Y = 120.0, 90.0

    def sampled(self, surface, cells, num_seas, points):
        nx, ny = cells
        solver = ShallowWater(size=(self.X, self.Y), cells=cells, depth=10, interval=1, num_seas=num_seas)
        solver.set_state(many(surface(centres(nx, self.X), centres(ny, self.Y)[:, None]), num_seas))
        found = np.zeros((num_seas, len(points), 3), np.float32)
        sample_all(solver.eta, points.astype(np.float32), found, solver.dx, solver.dy, nx, ny)
        return found

    @pytest.mark.parametrize(("cells", "num_seas"), [((40, 30), 1), ((3, 3), 2), ((20, 15), 18)])
    def test_plane_is_exact_up_to_the_boundary(self, cells, num_seas):
        points = np.random.default_rng(3).uniform(0, 1, (300, 2)) * (self.X, self.Y)
        points[:3] = (0, 0), (self.X, self.Y), (0, self.Y)
        found = self.sampled(lambda x, y: 0.5 + 0.02 * x - 0.03 * y, cells, num_seas, points)
        x, y = points.T
        plane = np.stack([0.5 + 0.02 * x - 0.03 * y, 0.02 + 0 * x, -0.03 + 0 * x], axis=1)
        scale = np.arange(1, num_seas + 1)[:, None, None]
        np.testing.assert_allclose(found / scale, np.broadcast_to(plane, found.shape), atol=2e-6)

    def test_elevation_and_slopes_are_second_order(self):
        k, m = 2 * math.pi / self.X, 1.5 * math.pi / self.Y
        points = np.random.default_rng(4).uniform(0, 1, (2000, 2)) * (self.X, self.Y)
        x, y = points.T
        exact = [np.cos(k * x) * np.cos(m * y), -k * np.sin(k * x) * np.cos(m * y), -m * np.cos(k * x) * np.sin(m * y)]
        errors = []
        for n in (40, 80):
            found = self.sampled(lambda x, y: np.cos(k * x) * np.cos(m * y), (n, n), 1, points)[0]
            errors.append(np.sqrt(np.mean((found - np.stack(exact, axis=1)) ** 2, axis=0)))
        for series in zip(*errors, strict=True):
            assert 1.8 < order(series) < 2.4

    def test_outside_is_clamped(self):
        inside, outside = np.array([[0.0, 40.0], [self.X, self.Y]]), np.array([[-30.0, 40.0], [1e6, 1e6]])
        surface = lambda x, y: 0.1 * x + 0.2 * y  # noqa: E731
        np.testing.assert_array_equal(
            self.sampled(surface, (20, 15), 1, inside), self.sampled(surface, (20, 15), 1, outside)
        )
