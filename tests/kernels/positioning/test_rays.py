"""Rays and profiles: arcs against a fine numerical ray, Snell's law, straight lines, convergence, fixes, refusals."""

import importlib.util
import math

import numpy as np
import pytest
import torch
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from usvauv.env.site.sound_speed import SoundSpeedError, SoundSpeedProfile
from usvauv.kernels.positioning import rays

THERMOCLINE = SoundSpeedProfile.from_table([(0, 1522.0), (20, 1522.3), (50, 1492.0), (200, 1490.0)])
MELTWATER = SoundSpeedProfile.from_table([(0, 1440.0), (3, 1440.0), (20, 1475.0), (60, 1480.0), (200, 1482.0)])
ISOTHERMAL = SoundSpeedProfile.from_table([(0, 1490.0), (200, 1493.3)])
DUCT = SoundSpeedProfile.from_table([(0, 1500.0), (30, 1510.0), (60, 1480.0), (90, 1495.0), (200, 1492.0)])
PROFILES = {"thermocline": THERMOCLINE, "meltwater": MELTWATER, "isothermal": ISOTHERMAL, "duct": DUCT}


def tensor(values, device) -> torch.Tensor:
    return torch.tensor(np.asarray(values), dtype=torch.float32, device=device)


def eigenrays(profile, ends, device) -> np.ndarray:
    return rays.eigenrays(tensor(profile.layers(), device), tensor(ends, device)).double().cpu().numpy()


def there_and_back(profile, depth, offset, c, device, assumed=None) -> tuple[np.ndarray, np.ndarray]:
    """Arrivals (n, 5) and the positions found from them (n, 3), by another profile if one is assumed."""
    depth, offset = tensor(depth, device), tensor(offset, device)
    arrivals = rays.arrivals(tensor(profile.layers(), device), depth, offset, c)
    back = rays.positions(tensor((assumed or profile).layers(), device), depth, arrivals, c)
    return arrivals.double().cpu().numpy(), back.double().cpu().numpy()


def numerical_ray(speed, gradient, depth, angle, time, breaks=()):
    """Integrate dr/dt = c sin θ, dz/dt = c cos θ, dθ/dt = c' sin θ, anew from each depth where c' jumps."""

    def motion(_, y):
        c = speed(y[1])
        return [c * math.sin(y[2]), c * math.cos(y[2]), gradient(y[1]) * math.sin(y[2])]

    state, now = [0.0, depth, angle], 0.0
    for stop in [*(b for b in breaks if b > depth), math.inf]:

        def arrives(_, y, stop=stop):
            return y[1] - stop if math.isfinite(stop) else -1.0

        arrives.terminal = True
        found = solve_ivp(motion, (now, time), state, "DOP853", events=arrives, rtol=1e-11, atol=1e-10)
        state, now = found.y[:, -1].tolist(), found.t[-1]
        if found.status == 0:
            break
        state[1] = stop + 1e-9
    return state


def exact_eigenray(speed, shallow, deep, R, fastest) -> tuple[float, float]:
    """Slowness (s/m) and travel time (s) in a smooth profile by quadrature in double precision."""

    def integral(xi, power):
        return quad(lambda z: speed(z) ** power / math.sqrt(1 - (xi * speed(z)) ** 2), shallow, deep, epsabs=1e-13)[0]

    xi = brentq(lambda xi: xi * integral(xi, 1) - R, 0, (1 - 1e-9) / fastest, xtol=1e-18)
    return xi, integral(xi, -1)


class TestEigenray:
    @pytest.mark.parametrize("name", PROFILES)
    def test_a_fine_numerical_ray_ends_at_the_source(self, device, name):
        """Sent out from the array at the angle found, integrated for the time found."""
        profile = PROFILES[name]
        ends = np.array([(a, b, R) for a, b in ((0, 100), (-6, 40), (12, 150)) for R in (0.5, 40, 150, 350)], float)
        for (shallow, deep, R), (xi, upper, lower, time, exists) in zip(
            ends, eigenrays(profile, ends, device), strict=True
        ):
            assert exists
            slopes = np.append(np.diff(profile.speeds) / np.diff(profile.depths), 0.0)

            def gradient(z, slopes=slopes):
                row = np.searchsorted(profile.depths, z, "right") - 1
                return 0.0 if row < 0 else slopes[row]

            angle = math.atan2(xi * profile.at(shallow), upper)
            r, z, final = numerical_ray(profile.at, gradient, shallow, angle, time, profile.depths)
            assert math.hypot(r - R, z - deep) < 5e-4 + 1e-6 * R
            assert math.cos(final) == pytest.approx(lower, abs=3e-6)

    @pytest.mark.parametrize("name", PROFILES)
    def test_snells_law(self, device, name):
        profile = PROFILES[name]
        ends = np.array([(a, b, R) for a in (0, 10, 35) for b in (45, 80, 130) for R in (5, 50, 200)], float)
        found = eigenrays(profile, ends, device)
        for column, depth in ((1, ends[:, 0]), (2, ends[:, 1])):
            c = np.array([profile.at(z) for z in depth])
            assert np.hypot(found[:, column], found[:, 0] * c) == pytest.approx(1.0, abs=5e-7)

    @pytest.mark.parametrize("gradient", [0.0, 1e-7, -1e-5, 1e-3])
    def test_next_to_no_gradient_gives_straight_lines_to_rounding(self, device, gradient):
        profile = SoundSpeedProfile.from_table([(z, 1500 + gradient * z) for z in (0, 7, 60, 300)])
        R = np.array([0.0, 1e-3, 1.0, 30.0, 300.0, 5000.0])
        ends = np.stack([np.full_like(R, -5), np.full_like(R, 105), R], axis=1)
        xi, upper, lower, time, exists = eigenrays(profile, ends, device).T
        S, c = np.hypot(110, R), profile.harmonic_mean(-5, 105)
        bend = gradient * R / 1500  # by how much an arc's direction changes
        assert exists.all()
        assert time == pytest.approx(S / c, rel=5e-7 + np.max(bend**2) / 20)
        assert xi == pytest.approx(R / S / c, rel=8e-7 + gradient**2)
        assert np.abs(np.stack([upper, lower]) - 110 / S).max() < 4e-7 + np.abs(bend).max()

    def test_one_gradient_in_closed_form(self, device):
        """Time between two points of a medium of one gradient: arcosh(1 + g² d²/(2 c₁ c₂))/|g|."""
        profile = SoundSpeedProfile.from_table([(0, 1400.0), (400, 1600.0)])
        R = np.array([1e-2, 10.0, 100.0, 1000.0])
        ends = np.stack([np.full_like(R, 50), np.full_like(R, 350), R], axis=1)
        found = eigenrays(profile, ends, device)
        time = np.arccosh(1 + 0.5**2 * (300**2 + R**2) / (2 * 1425 * 1575)) / 0.5
        assert found[:, 3] == pytest.approx(time, rel=5e-7)

    def test_a_layer_of_all_speeds(self, device):
        """From 1300 to 1700 m/s in 100 m, up to next to the horizontal ray, with every form of the arcs' functions."""
        profile = SoundSpeedProfile.from_table([(0, 1300.0), (100, 1700.0)])
        R = np.linspace(0.5, 0.999 * math.sqrt(1700**2 - 1300**2) / 4, 400)
        for bottom in (100.0, 50.0, 25.0):
            ends = np.stack([0 * R, 0 * R + bottom, R * bottom / 100], axis=1)
            c = 1300 + 4 * bottom
            time = np.arccosh(1 + 4**2 * (bottom**2 + ends[:, 2] ** 2) / (2 * 1300 * c)) / 4
            assert eigenrays(profile, ends, device)[:, 3] == pytest.approx(time, rel=7e-7)
            offset = np.stack([ends[:, 2], 0 * R, 0 * R - bottom], axis=1)
            _, back = there_and_back(profile, 0 * R, offset, 1500.0, device)
            assert np.abs(back - offset).max() < 4e-4

    @pytest.mark.parametrize(("top", "bottom"), [(1520.0, 1480.0), (1480.0, 1520.0)])
    def test_no_direct_ray_beyond_the_horizontal_one(self, device, top, bottom):
        profile = SoundSpeedProfile.from_table([(0, top), (100, bottom)])
        farthest = math.sqrt(1520**2 - 1480**2) / 0.4
        shares = np.array([0.5, 0.99, 0.9999, 1.0001, 1.01, 10.0])
        ends = np.stack([0 * shares, 0 * shares + 100, shares * farthest], axis=1)
        found = eigenrays(profile, ends, device)
        assert found[:, 4].tolist() == [1, 1, 1, 0, 0, 0]
        assert np.isfinite(found).all()
        time = np.arccosh(1 + 0.4**2 * (100**2 + ends[:, 2] ** 2) / (2 * 1520 * 1480)) / 0.4
        assert found[:3, 3] == pytest.approx(time[:3], rel=5e-7)

    @pytest.mark.parametrize(
        ("speed", "ends"),
        [
            (lambda z: 1490 + 30 * math.exp(-z / 25), (0.0, 100.0, 180.0)),
            (lambda z: 1500 * (1 + 0.00737 * (z / 650 - 3 + math.exp(2 - z / 650))), (0.0, 4000.0, 5000.0)),
        ],
        ids=["thermocline", "Munk"],
    )
    def test_layers_converge_to_a_smooth_profile_in_second_order(self, device, speed, ends):
        shallow, deep, R = ends
        exact = exact_eigenray(speed, shallow, deep, R, max(speed(z) for z in np.linspace(shallow, deep, 4001)))
        errors = []
        for layers in (8, 16, 32):
            z = np.linspace(0, deep, layers + 1)
            profile = SoundSpeedProfile.from_table([(d, speed(d)) for d in z])
            found = eigenrays(profile, [ends], device)[0, [0, 3]]
            errors.append(np.abs(found / exact - 1))
        order = np.log2(np.array(errors[:-1]) / errors[1:])
        assert errors[-1].max() < 2e-4
        assert errors[-1].min() > 1e-6  # well above rounding, or the order would mean nothing
        assert order[-1] == pytest.approx(2.0, abs=0.25)

    def test_both_directions(self, device):
        """From below or from above: the same time and slowness, the direction turned about."""
        for depth, other in ((0.0, 90.0), (33.0, 140.0)):
            down, _ = there_and_back(THERMOCLINE, [depth], [[60, -80, depth - other]], 1500.0, device)
            up, _ = there_and_back(THERMOCLINE, [other], [[-60, 80, other - depth]], 1500.0, device)
            assert up[0, 3] == pytest.approx(down[0, 3], rel=1e-7)
            assert up[0, :2] == pytest.approx(-down[0, :2], abs=1e-7)
            ratio = THERMOCLINE.at(depth) / THERMOCLINE.at(other)
            assert np.linalg.norm(up[0, :3]) / np.linalg.norm(down[0, :3]) == pytest.approx(ratio, rel=1e-6)
            assert down[0, 2] < 0 < up[0, 2]


class TestFix:
    def offsets(self, count=4000, reach=300.0):
        random = np.random.default_rng(5)
        elevation = random.uniform(-10, 10, count)
        across = random.uniform(-reach, reach, (count, 2))
        across[:10] *= 1e-3
        return -elevation, np.column_stack([across, -100 - elevation])

    @pytest.mark.parametrize("name", PROFILES)
    def test_down_the_ray_to_the_source(self, device, name):
        depth, offset = self.offsets()
        arrivals, back = there_and_back(PROFILES[name], depth, offset, 1500.0, device)
        assert (arrivals.shape, back.shape) == ((len(depth), 5), (len(depth), 3))
        assert (arrivals[:, 4] == 1).all()
        assert np.abs(back - offset).max() < 1e-3

    @pytest.mark.parametrize("name", ["thermocline", "duct"])
    def test_up_the_ray_to_a_source_in_a_crest(self, device, name):
        """Two metres and more above the mean surface, where the sound is as fast as there."""
        offset = np.array([[3.0, 4.0, 112.0], [40.0, -30.0, 115.0], [-60.0, 10.0, 113.0]])
        arrivals, back = there_and_back(PROFILES[name], np.full(3, 110.0), offset, 1500.0, device)
        assert (arrivals[:, 4] == 1).all()
        assert np.abs(back - offset).max() < 1e-3

    def test_at_constant_speed_it_is_geometry(self, device):
        depth, offset = self.offsets()
        arrivals, _ = there_and_back(SoundSpeedProfile.constant(1500.0), depth, offset, 1500.0, device)
        S = np.linalg.norm(offset, axis=1)
        assert np.abs(arrivals[:, :3] - offset / S[:, None]).max() < 5e-7
        assert arrivals[:, 3] == pytest.approx(S, rel=6e-7)

    @pytest.mark.parametrize("name", PROFILES)
    def test_bias_of_a_straight_line(self, device, name):
        """Near the nadir x̂/x = c²/(c_h c_a) with the harmonic and arithmetic mean: next to none with c = c_h."""
        profile = PROFILES[name]
        mean = profile.harmonic_mean(0, 100)
        z = np.linspace(0, 100, 100001)
        arithmetic = np.trapezoid(np.interp(z, profile.depths, profile.speeds), z) / 100
        for c in (profile.at(0), mean):
            arrivals, back = there_and_back(profile, [0.0], [[2.0, 0, -100]], c, device)
            assert arrivals[0, 3] * arrivals[0, 0] / 2 == pytest.approx(c * c / mean / arithmetic, rel=2e-5)
            assert back[0] == pytest.approx([2, 0, -100], abs=2e-4)
        arrivals, _ = there_and_back(profile, [0.0], [[100.0, 0, -100]], mean, device)
        assert abs(arrivals[0, 3] * arrivals[0, 0] - 100) < 0.03

    def test_a_profile_wrong_by_1_m_per_s(self, device):
        """The whole profile too fast by 1 m/s: the fix moves outwards by 2/c of its range near the nadir."""
        faster = SoundSpeedProfile(THERMOCLINE.depths, THERMOCLINE.speeds + 1)
        _, back = there_and_back(THERMOCLINE, [0.0], [[20.0, 0, -100]], 1500.0, device, assumed=faster)
        assert back[0, 0] - 20 == pytest.approx(20 * 2 / 1500, rel=0.03)

    @pytest.mark.parametrize("name", PROFILES)
    def test_noise_near_the_horizontal_stays_finite(self, device, name):
        random = np.random.default_rng(2)
        arrivals = np.zeros((2000, 5))
        arrivals[:, :2] = random.uniform(-1.2, 1.2, (2000, 2))
        arrivals[:, 3] = random.uniform(1, 3000, 2000)
        place = rays.positions(
            tensor(PROFILES[name].layers(), device),
            tensor(random.uniform(-10, 10, 2000), device),
            tensor(arrivals, device),
            1500.0,
        )
        assert torch.isfinite(place).all()
        assert (place.double().norm(dim=1).cpu().numpy() < arrivals[:, 3] * 1.03).all()

    def test_an_arrival_beyond_the_horizontal_is_taken_as_horizontal(self, device):
        arrivals = torch.tensor([[0.9, 1.2, 0.0, 300.0, 1.0], [1.8, 2.4, 0.0, 300.0, 1.0]], device=device)
        layers = tensor(THERMOCLINE.layers(), device)
        beyond = rays.positions(layers, torch.full((2,), 30.0, device=device), arrivals, 1500.0).cpu().numpy()
        assert beyond[0] == pytest.approx(beyond[1], abs=1e-4)
        assert beyond[0, 2] < -5  # bent down by the thermocline

    def test_without_a_direct_ray_the_line_is_straight_and_says_so(self, device):
        steep = SoundSpeedProfile.from_table([(0, 1480.0), (100, 1520.0)])
        arrivals, _ = there_and_back(steep, [0.0], [[3000.0, 0, -100]], 1500.0, device)
        assert arrivals[0, 4] == 0
        assert arrivals[0, 3] == pytest.approx(math.hypot(3000, 100), rel=1e-6)


class TestProfile:
    def test_harmonic_mean(self):
        for profile in PROFILES.values():
            breaks = [z for z in profile.depths if z < 100]
            time = quad(lambda z, p=profile: 1 / p.at(z), -5, 100, points=breaks, epsabs=1e-14)[0]
            assert profile.harmonic_mean(-5, 100) == pytest.approx(105 / time, rel=1e-10)
        assert SoundSpeedProfile.constant(1487.5).harmonic_mean(0, 80) == pytest.approx(1487.5, rel=1e-15)

    @pytest.mark.parametrize(
        ("rows", "message"),
        [
            ([], "at least one row"),
            ([(0, 1500), (10,)], "row 2 has 1 numbers; expected 2: depth, speed"),
            ([(0, 1500), (10, math.nan)], "row 2: 10, nan: not a finite number"),
            ([(0, 1500), (10, 1490), (10, 1480)], "depths must rise: 10 m follows 10 m"),
            ([(0, 1500), (-10, 1490)], "depth -10 m; allowed: 0 to 11000 m, positive downwards"),
            ([(20, 1500)], "first depth 20 m"),
            ([(0, 1500), (10, 4921)], "speed 4921 m/s at 10 m; allowed: 1300 to 1700"),
            ([(0, 1.5)], "speed 1.5 m/s at 0 m"),
        ],
    )
    def test_refused_tables(self, rows, message):
        with pytest.raises(SoundSpeedError, match=message.replace("(", r"\(")) as refusal:
            SoundSpeedProfile.from_table(rows)
        assert "\n" not in str(refusal.value)

    def test_a_table_that_ends_above_the_source(self):
        THERMOCLINE.check_reaches(200)
        SoundSpeedProfile.constant(1500).check_reaches(5000)
        with pytest.raises(SoundSpeedError, match="last depth 200 m; the profile must reach 201 m"):
            THERMOCLINE.check_reaches(201)


class TestWater:
    @pytest.fixture(autouse=True)
    def _library(self):
        pytest.importorskip("gsw")

    def test_published_value(self):
        """The check value of TEOS-10 for SA = 34.7118 g/kg, t = 28.7856 °C, p = 10 dbar."""
        import gsw

        z = -float(gsw.z_from_p(10.0, 4.0))
        profile = SoundSpeedProfile.from_water(
            [(z, 28.7856, 34.7118), (50, 28.4329, 34.8915)], latitude=4, longitude=188, salinity="absolute"
        )
        assert profile.speeds[0] == pytest.approx(1542.615803587414, abs=1e-8)

    def test_near_another_formula(self):
        """Mackenzie, J. Acoust. Soc. Am. 70 (1981) 807, doi 10.1121/1.386920."""
        for T, S in ((4.0, 35.0), (12.0, 34.0), (22.0, 36.5)):
            profile = SoundSpeedProfile.from_water([(0, T, S), (300, T, S)], latitude=40, longitude=-30)
            for D in (0.0, 300.0):
                c = 1448.96 + 4.591 * T - 5.304e-2 * T**2 + 2.374e-4 * T**3 + 1.340 * (S - 35) + 1.630e-2 * D
                c += 1.675e-7 * D**2 - 1.025e-2 * T * (S - 35) - 7.139e-13 * T * D**3
                assert profile.at(D) == pytest.approx(c, abs=0.15)

    def test_between_rows_temperature_is_linear_and_not_speed(self):
        import gsw

        rows = [(0, 24, 36.0), (40, 10, 35.0), (100, 9, 35.0)]
        profile = SoundSpeedProfile.from_water(rows, latitude=40, longitude=-30)
        z = np.linspace(0, 100, 501)
        depth, t, s = np.array(rows, float).T
        p = gsw.p_from_z(-z, 40)
        salt = gsw.SA_from_SP(np.interp(z, depth, s), p, -30, 40)
        exact = gsw.sound_speed_t_exact(salt, np.interp(z, depth, t), p)
        assert np.abs(np.interp(z, profile.depths, profile.speeds) - exact).max() < 0.006

    @pytest.mark.parametrize(
        ("rows", "options", "message"),
        [
            ([(0, 283, 35), (9, 283, 35)], {}, "temperature 283 °C at 0 m; allowed: -3 to 45 °C; kelvins"),
            ([(0, 10, 0.035), (9, 10, 0.035)], {}, "salinity 0.035 at 0 m looks like kg/kg"),
            ([(0, 10, 350), (9, 10, 350)], {}, "salinity 350"),
            ([(0, 10, 35)], {}, "at least two rows"),
            ([(0, 10, 35), (9, 10, 35)], {"salinity": "psu"}, "'psu' is not one of practical, absolute"),
            ([(0, 10, 35), (9, 10, 35)], {"latitude": 95}, "latitude 95"),
            ([(0, 10, 35), (9, 10, 35)], {"latitude": -89}, "TEOS-10 knows no sea there"),
        ],
    )
    def test_refused_water(self, rows, options, message):
        with pytest.raises(SoundSpeedError, match=message):
            SoundSpeedProfile.from_water(rows, **{"latitude": 50, **options})


def test_without_gsw(monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: None if name == "gsw" else find(name, *a))
    with pytest.raises(SoundSpeedError, match="need the library gsw: pip install gsw"):
        SoundSpeedProfile.from_water([(0, 10, 35), (9, 10, 35)], latitude=50)
