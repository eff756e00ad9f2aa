"""The gate beside NumPy, the likelihood of whole turns, and where turns are possible at all."""

import math

import numpy as np
import pytest
import taichi as ti
import torch
from scipy import stats

from usvauv.kernels.positioning import acoustic_link, usbl
from usvauv.kernels.types import vec2, vec3

ARRAY = ti.types.ndarray(dtype=ti.f32, ndim=2)


def test_the_gate_is_a_quantile_of_chi_square():
    assert pytest.approx(stats.chi2.isf(1e-3, 2)) == usbl.GATE


@pytest.mark.parametrize("reach", [0.0, 3.0])
def test_squared_innovation_beside_numpy(device, reach):
    random = np.random.default_rng(1)
    root = random.normal(0, 1, (2, 50, 2, 2))
    P, R = (root @ root.swapaxes(-1, -2)).astype(np.float32) + 0.1 * np.eye(2, dtype=np.float32)
    nu = random.uniform(-8, 8, (50, 2)).astype(np.float32)
    upper = [0, 0, 1], [0, 1, 1]
    rows = np.concatenate([nu, P[:, *upper], R[:, *upper]], axis=1).astype(np.float32)
    found = torch.zeros((50, 1), device=device)

    @ti.kernel
    def run(rows: ARRAY, found: ARRAY, reach: ti.f32):
        for n in range(found.shape[0]):
            C = vec3(rows[n, 2], rows[n, 3], rows[n, 4])
            expected = usbl.Expectation(place=vec2(5.0, -7.0), covariance=C, reach=reach, separation=0.0)
            R = vec3(rows[n, 5], rows[n, 6], rows[n, 7])
            found[n, 0] = usbl.squared_innovation(expected, vec2(5.0 + rows[n, 0], rows[n, 1] - 7.0), R)

    run(torch.from_numpy(rows).to(device), found, reach)
    length = np.linalg.norm(nu, axis=1, keepdims=True).astype(float)
    beyond = nu / length * np.maximum(length - reach, 0)
    exact = np.einsum("ni,nij,nj->n", beyond, np.linalg.inv((P + R).astype(float)), beyond)
    assert found.cpu().numpy()[:, 0] == pytest.approx(exact, rel=1e-4, abs=1e-4)
    assert (exact == 0).any() == (reach > 0)


def test_cost_is_bounded_by_the_gate_and_grows_with_the_wrong_depth(device):
    link = torch.from_numpy(
        acoustic_link.link_table(
            (15000.0,), acoustic_link.Sonar(spacing=0.06, accuracy=acoustic_link.Accuracy(attitude=0.002))
        )
    ).to(device)
    cases = [(30.0, 40.0, -100.0), (330.0, 40.0, -100.0), (30.0, 40.0, -90.0), (330.0, 40.0, -90.0)]
    offset, found = torch.tensor(cases, device=device), torch.zeros((4, 1), device=device)

    @ti.kernel
    def run(link: ARRAY, offset: ARRAY, found: ARRAY):
        for n in range(found.shape[0]):
            expected = usbl.Expectation(
                place=vec2(30.5, 40.0), covariance=vec3(0.2, 0.0, 0.2), reach=0.0, separation=100.0
            )
            place = vec3(offset[n, 0], offset[n, 1], offset[n, 2])
            found[n, 0] = usbl.candidate_cost(link, 0, expected, place, vec3(0.3, 0.0, 0.3), 0.02)

    run(link, offset, found)
    kappa = 2 * math.pi * 15000 * 0.06 / 1500
    for (x, y, z), cost in zip(cases, found[:, 0].tolist(), strict=True):
        prior = min(((x - 30.5) ** 2 + (y - 40) ** 2) / 0.5, 2 * 13.8155)
        S2 = x * x + y * y + z * z
        error = math.hypot(x, y) - math.sqrt(S2 - 100**2) if S2 > 100**2 else math.hypot(x, y)
        depth = error**2 / (S2 * ((0.02 / kappa) ** 2 + 0.002**2 + 0.01**2))
        assert cost == pytest.approx(prior + depth, rel=1e-3, abs=1e-3)


@pytest.mark.parametrize(
    ("spacing", "periods", "possible"), [(0.033, 10, False), (0.045, 10, True), (0.036, 10, False), (0.036, 1, True)]
)
def test_turns_are_possible_from_half_a_wavelength_on(spacing, periods, possible):
    table = acoustic_link.link_table((15000.0, 18000.0), acoustic_link.Sonar(spacing=spacing, periods=periods))
    assert usbl.turns_possible(table) == possible


@pytest.mark.parametrize("spacing", [0.033, 0.06, 0.11, 0.23])
def test_most_turns_reach_every_direction(device, spacing):
    link = torch.from_numpy(acoustic_link.link_table((15000.0,), acoustic_link.Sonar(spacing=spacing))).to(device)
    found = torch.zeros((1, 1), device=device)

    @ti.kernel
    def run(link: ARRAY, found: ARRAY):
        for n in range(found.shape[0]):
            found[n, 0] = ti.cast(usbl.most_turns(link, 0, 1.0), ti.f32)

    run(link, found)
    phase = 2 * math.pi * spacing / 0.1 * np.linspace(-1, 1, 100_001)
    assert found.item() == np.abs(np.round(phase / (2 * math.pi))).max()


def test_turns_are_possible_where_noise_can_wrap_one_of_the_links():
    """Six standard deviations of a difference at the threshold, σ = 0.1, against the 2 (π − κ) to a wrap."""
    link = np.zeros((2, acoustic_link.COLUMNS))
    link[:, acoustic_link.THRESHOLD] = 8 / 0.1**2
    for kappas, possible in (((2.0, 2.83), False), ((2.0, 2.85), True), ((2.85, 2.0), True), ((4.0, 2.0), True)):
        link[:, acoustic_link.KAPPA] = kappas
        assert usbl.turns_possible(link) == possible
