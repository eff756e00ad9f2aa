"""Layouts, and objectives of the planner in double precision with their global maxima by dense search."""

import math

import numpy as np
import torch
from torch.func import grad, jacrev, vmap

from usvauv.kernels.planning import objectives
from usvauv.kernels.positioning import acoustic_link, sonar
from usvauv.kernels.positioning.sonar import coates

CODES = {
    f"{objective} {measurement}": objectives.objective_code(measurement, objective)
    for objective in objectives.OBJECTIVES
    for measurement in ("phase", "fix")
    if (objective, measurement) != ("paper", "fix")
}
SYSTEMATIC = {  # standard deviations by column of the link table
    acoustic_link.ALIGNMENT: 0.007,
    acoustic_link.HEADING: 0.01,
    acoustic_link.SOUND_SPEED: 0.006,
    acoustic_link.POSITION: 0.5,
}
KINDS = ("uniform", "collinear", "coincident", "corners", "outside", "depths", "shallow")


def loss(r, f):
    """15 log10 r and Thorp's absorption, dB."""
    return sonar.path_loss(r, 15.0, sonar.thorp(f))


def carriers(K):
    return [15000.0, 18000.0, *np.linspace(12000.0, 18000.0, K)[1:-1]][:K]


def table(device, K, attitude_error=0.0, systematic=False, **link):
    sonar = acoustic_link.Sonar(accuracy=acoustic_link.Accuracy(attitude=attitude_error), **link)
    rows = torch.from_numpy(acoustic_link.link_table(carriers(K), sonar))
    if systematic:
        rows[:, list(SYSTEMATIC)] = torch.tensor(list(SYSTEMATIC.values())) ** 2
    return rows.to(device)


# A transponder of which a third of the fixes from anywhere in 200 m are good, with bubbles.
WEAK = {"path": "transponder", "source_level": 108.0, "wind": 12.0, "bubbles": True, "unlocated": 58.0}


def random_layouts(kind, n, K, box, seed):
    """Layouts (n, K, 3) of AUVs about 100 m below a box [0, box]²."""
    g = torch.Generator().manual_seed(seed)
    place = box * torch.rand(n, K, 2, generator=g)
    z = -100 + 4 * torch.randn(n, K, generator=g)
    if kind == "collinear":
        ends = box * torch.rand(n, 2, 1, 2, generator=g)
        share = torch.rand(n, K, 1, generator=g)
        place = ends[:, 0] + (ends[:, 1] - ends[:, 0]) * share + 0.1 * torch.randn(n, K, 2, generator=g)
    elif kind == "coincident":
        place = place[:, :1] + 0.3 * torch.randn(n, K, 2, generator=g) * (torch.arange(n) % 2)[:, None, None]
    elif kind == "corners":
        place = torch.where(torch.rand(n, K, 2, generator=g) < 0.5, 0.05 * place, box - 0.05 * place)
    elif kind == "outside":
        place = 1.6 * place - 0.3 * box
    elif kind == "depths":
        z = -5 - 295 * torch.rand(n, K, generator=g)
    elif kind == "shallow":  # 10 to 40 m below the corners: many hills
        place = torch.where(torch.rand(n, K, 2, generator=g) < 0.5, 0.2 * place, box - 0.2 * place)
        z = -(10 + 30 * torch.rand(n, 1, generator=g)) * (1 + 0.1 * torch.randn(n, K, generator=g))
    return torch.cat([place, z[..., None]], -1).float().contiguous()


def sigma(K, S, source_level=162.0):
    """Standard deviation (rad) of the phase differences of an echo at slant ranges S (K,), straight from the laws."""
    out = []
    for f, s in zip(carriers(K), S, strict=True):
        snr = source_level - 2 * loss(s, f) + 3.0 - sonar.noise_level(coates(f, 0.5, 0.0), 1000.0)
        out.append(math.sqrt(10 ** (-snr / 10) / (1000.0 * 10 / f)))  # E/N0 = SNR · B · T, ten periods
    return torch.tensor(out, dtype=torch.float64)


def log_good(T, q, z2, link):
    """ln of the probability of a good fix, by numbers of the link table: detected, and not beyond the horizon."""
    column = acoustic_link
    kappa, horizon = link[..., column.KAPPA], link[..., column.HORIZON]
    per_db = 0.1 * math.log(10) * link[..., column.NOISE_EXPONENT] * link[..., column.PATHS]
    bubbles = (link[..., column.BUBBLES] * (q / z2).sqrt()).clamp(max=column.MOST_BUBBLES)
    energy = 8 * q * T / kappa**2 * torch.exp(-per_db * bubbles)
    above = (energy + 7).sqrt() - link[..., column.THRESHOLD].sqrt()
    within = (horizon**2 - kappa**2 * (1 - z2 / q)) * energy.sqrt() / (2 * math.sqrt(8) * horizon)
    return sum(torch.nn.functional.logsigmoid(1.702 * u) for u in (above, within))


def log_objective(boat, auvs, link, code):
    """ln of the objective in r̂, t̂ form and double precision: boat (..., 2), auvs (..., K, 3), link (..., K, :)."""
    d = auvs[..., :2] - boat[..., None, :]
    z2 = auvs[..., 2].square().clamp(min=1.0)
    rho2 = d.square().sum(-1)
    q = rho2 + z2
    S0 = link[..., acoustic_link.REFERENCE]
    log_T = (
        link[..., acoustic_link.LEVEL]
        - link[..., acoustic_link.POWER] * torch.log(q / S0**2)
        - link[..., acoustic_link.DECAY] * (q.sqrt() - S0)
    )
    T, s2 = log_T.exp(), z2 / q
    uncertain = link[..., acoustic_link.CERTAIN] > 0
    # Without a limit of certainty all fixes are good; `where` alone would spread what is not finite to derivatives.
    usable = torch.where(uncertain[..., None], link, torch.ones_like(link))
    good = torch.where(uncertain, log_good(T, q, z2, usable), 0.0)
    cross = d[..., :, None, 0] * d[..., None, :, 1] - d[..., :, None, 1] * d[..., None, :, 0]
    if code == CODES["paper phase"]:
        weight = T * (1 + s2**2) / (rho2 + 1)
        pairs = (weight[..., :, None] * weight[..., None, :] * cross.square()).sum((-1, -2)) / 2
        return (3 * (T.square() * s2).sum(-1) + pairs).log()
    v = 1 / T + link[..., acoustic_link.ATTITUDE] * z2
    without = link[..., acoustic_link.UNLOCATED]  # ln det J_0
    if code in (CODES["sum fix"], CODES["sum phase"]):
        v = v / good.exp()
    if code == CODES["sum fix"]:
        return 2 * (1 / v).sum(-1).log()
    if code == CODES["sum phase"]:
        # Sum over pairs of det (s⁴ r̂r̂ᵀ + t̂t̂ᵀ) terms: free of the cancellation that J11 J22 − J12² has.
        a, b = s2**2 / v, (1 + s2) / q / v
        tall = (b * rho2).sum(-1)
        pairs = (b[..., :, None] * b[..., None, :] * cross.square()).sum((-1, -2)) / 2
        return (a.sum(-1) ** 2 + a.sum(-1) * tall + pairs).log()
    by_phases = code in (CODES["d phase"], CODES["a phase"])
    alignment, heading, speed, place = (link[..., column] for column in SYSTEMATIC)
    turned = v + alignment * z2
    across = turned + place + heading * rho2
    along = (turned + speed * rho2) / s2**2 + place if by_phases else turned + place + 4 * speed * rho2
    p = good.exp()
    if code in (CODES["d phase"], CODES["d fix"]):
        with_fix = -(across * along).log()
        expected = p * torch.maximum(with_fix, without) + (1 - p) * without
        return torch.where(uncertain, expected, with_fix).sum(-1)
    none = 2 * torch.exp(-0.5 * without)  # tr J_0⁻¹
    expected = p * torch.minimum(across + along, none) + (1 - p) * none
    return -torch.where(uncertain, expected, across + along).sum(-1).log()


def best_by_dense_search(points, link, code, box):
    """Largest log objective of each layout over a grid of 5 m (200 m box), polished in double precision.

    Link table and side of the box are those of all layouts, or one each.
    """
    points, n, cells = points.double(), len(points), 41
    link, box = link.double().expand(n, -1, -1), torch.as_tensor(box, dtype=torch.float64).expand(n)[:, None, None]
    axis = torch.linspace(0, 1, cells, dtype=torch.float64)
    grid = torch.cartesian_prod(axis, axis) * box
    parts = zip(grid.split(50), points[:, None].split(50), link[:, None].split(50), strict=True)
    value = torch.cat([log_objective(*part, code) for part in parts])
    image = value.reshape(n, 1, cells, cells)
    peak = image >= torch.nn.functional.max_pool2d(image, 3, 1, 1)
    highest = torch.where(peak.reshape(n, -1), value, -torch.inf).topk(5, dim=1).indices
    x = torch.cat([grid[torch.arange(n)[:, None], highest], points[..., :2].clamp(min=0).minimum(box)], 1)
    return polished(x, points, link, code, box)


def polished(x, points, link, code, box):
    """Best of the maxima uphill of some places (n, m, 2), by Newton steps with derivatives from autograd.

    A place from which a step gains less than 1e-9 is at its maximum.
    """

    def f(boat, auvs, link):
        return log_objective(boat, auvs, link, code)

    gradient, curvature = vmap(grad(f)), vmap(jacrev(grad(f)))
    n, m, _ = x.shape
    x, points, link, box = x.flatten(0, 1), *(each.repeat_interleave(m, 0) for each in (points, link, box[:, 0]))
    best, rising = f(x, points, link), torch.arange(n * m)
    for _ in range(12):
        centre = there = x[rising]
        highest = start = best[rising]
        about, side = (points[rising], link[rising]), box[rising]
        g, H = gradient(centre, *about), curvature(centre, *about)
        held = ((centre <= 0) & (g < 0)) | ((centre >= side) & (g > 0))
        g = g.masked_fill(held, 0.0)
        H = H.masked_fill(held[..., None] | held[..., None, :], 0.0)
        root, V = torch.linalg.eigh(H)
        step = (V @ ((V.mT @ g[..., None]) / root.abs().clamp(min=1e-6)[..., None]))[..., 0]
        for halving in range(8):
            tried = (centre + 0.4**halving * step).clamp(min=0).minimum(side)
            height = f(tried, *about)
            better = height > highest
            highest, there = torch.where(better, height, highest), torch.where(better[..., None], tried, there)
        best[rising], x[rising] = highest, there
        rising = rising[highest > start + 1e-9]
        if len(rising) == 0:
            break
    return best.view(n, m).amax(1)


def unequal_links(K, seed, tables, n):
    """Side of the area (m), link table and layouts (n, K, 3), `tables` times: ln T differs by up to 40 among AUVs."""
    random = np.random.default_rng(seed)
    for i in range(tables):
        link = np.zeros((K, acoustic_link.COLUMNS), np.float32)
        link[:, acoustic_link.LEVEL] = random.uniform(0, 20) + random.choice([3.0, 10.0, 20.0]) * random.uniform(
            -1, 1, K
        )
        link[:, acoustic_link.POWER] = random.choice([1.0, 1.75, 2.5, 4.0])
        link[:, acoustic_link.DECAY] = random.choice([1.0, 0.0]) * 10 ** random.uniform(-4, -1.5, K)
        link[:, acoustic_link.REFERENCE] = random.choice([10.0, 100.0, 300.0])
        link[:, acoustic_link.ATTITUDE] = (0.0, 0.002, 0.01, 0.02)[i % 4] ** 2
        side = float(random.choice([200.0, 500.0, 2000.0]))
        if i % 3:
            deviations = [0.001, random.choice([0.0, 0.004, 0.02]), 7e-4, random.choice([0.0, 0.3])]
            link[:, list(SYSTEMATIC)] = np.square(deviations)
        place = side * random.random((n, K, 2))
        z = -np.exp(random.uniform(np.log(3), np.log(500), (n, K, 1)))
        yield side, torch.from_numpy(link), torch.from_numpy(np.concatenate([place, z], -1).astype(np.float32))
