"""Errors of a fix beside noise: each and all together are as large in missions as their covariance says."""

import math

import numpy as np
import pytest
import taichi as ti
import torch

from tests.links import EVERY_STEP
from usvauv.env import Scenario, World
from usvauv.env.planning.fix_errors import error_budget, reception
from usvauv.env.site.site import Site
from usvauv.env.world.tables import link_table
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn
from usvauv.kernels.positioning import acoustic_link, sonar, usbl
from usvauv.kernels.positioning.sonar import coates
from usvauv.kernels.types import vec3

QUIET = [
    *EVERY_STEP,
    "acoustics.path=transponder",
    "acoustics.source_level=187",
    "acoustics.spreading=20",
    "acoustics.bandwidth=4000",
    "usbl.signal=code",
    "usbl.propagation=false",
    "nodes.count=4",
]
ERRORS = {
    "noise": ["usbl.pulse_length=0.0005", "acoustics.source_level=165"],
    "attitude": ["usbl.attitude_error=0.002"],
    "alignment": ["usbl.alignment_error=0.003"],
    "heading": ["usbl.heading_error=0.003", "acoustics.source_level=165"],
    "speed of sound": ["acoustics.sound_speed_error=5"],
    "lever arm": ["usbl.lever_arm_error=0.1"],
    "position": ["usbl.gnss_error=0.5"],
}
ERRORS["all"] = [change for changes in ERRORS.values() for change in changes]
WORLDS = 4000


def errors_of_fixes(device, changes, steps, scenario="ideal"):
    """Errors (W · K, 2) of the fixes after some steps, and their covariances (W · K, 2, 2), m and m²."""
    world = World(Scenario.load(scenario, [*QUIET, *changes]), WORLDS, 5, usv="centroid")
    world.reset()
    for _ in range(steps):
        world.step(torch.zeros(WORLDS, 2, 2, device=device))
    auv = world.auv.double().cpu().numpy()
    error = auv[..., AuvColumn.span("fix_x", "fix_y")] - auv[..., AuvColumn.span("x", "y")]
    xx, xy, yy = np.moveaxis(auv[..., AuvColumn.span("covariance_xx", "covariance_yy")], -1, 0)
    C = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -1)
    return error.reshape(-1, 2), C.reshape(-1, 2, 2), world


@pytest.mark.parametrize("name", ERRORS)
@pytest.mark.parametrize("scenario", ["ideal", "extreme"])
def test_the_covariance_is_that_of_the_errors(device, scenario, name):
    """The mean of eᵀC⁻¹e is 2: worlds draw their errors independently, the AUVs of one world share them."""
    error, C, _ = errors_of_fixes(device, ERRORS[name], 3, scenario)
    normal = np.linalg.solve(np.linalg.cholesky(C + 1e-9 * np.eye(2)), error[..., None])[..., 0]
    squares = (normal**2).sum(-1).reshape(WORLDS, 2).mean(-1)
    assert np.isfinite(squares).all()
    assert squares.mean() == pytest.approx(2, abs=4 * squares.std() / np.sqrt(WORLDS))


@pytest.mark.parametrize("slant", [50.0, 200.0, 500.0])
def test_the_budget_is_the_error_of_missions(device, slant):
    """The rms of all errors together within a tenth, and each part alone as its closed form says."""
    changes = ["area.width=1000", "area.length=1000", "area.depth=60", "auv.depth=40", "sea.cell_size=20"]
    changes += ["acoustics.source_level=187", "usbl.attitude_error=0.0015", "usbl.alignment_error=0.002"]
    changes += ["usbl.heading_error=0.004", "acoustics.sound_speed_error=2", "usbl.lever_arm_error=0.05"]
    changes += ["usbl.gnss_error=0.3"]
    scenario = Scenario.load("ideal", [*QUIET, *changes])
    world = World(scenario, 40000, 6, usv="hold:500,500")
    world.reset()
    auv = world.auv.double().cpu().numpy()
    away = np.hypot(np.linalg.norm(auv[..., :2] - 500, axis=-1), 40)
    near = np.abs(away / slant - 1) < 0.05
    assert near.sum() > 100
    error = np.linalg.norm(auv[..., AuvColumn.span("fix_x", "fix_y")] - auv[..., :2], axis=-1)[near]
    link = torch.from_numpy(link_table(Site(scenario))).to(device)
    d = math.sqrt(slant**2 - 40**2)
    parts = error_budget(scenario, link, [(500 + d, 500.0, 40.0)] * 2, (500.0, 500.0), "fix", (0.0, 0.0))
    assert math.sqrt(np.mean(error**2)) == pytest.approx(parts["all"][0], rel=0.1)
    assert parts["pitch and roll"][0] == pytest.approx(math.sqrt(2) * 0.0015 * 40, rel=1e-3)
    assert parts["alignment"][0] == pytest.approx(math.sqrt(2) * 0.002 * 40, rel=1e-3)
    assert parts["heading"][0] == pytest.approx(0.004 * d, rel=1e-3)
    assert parts["speed of sound"][0] == pytest.approx(2 * 2 / 1500 * d, rel=1e-3)
    assert parts["lever arm"][0] == pytest.approx(math.sqrt(2) * 0.05, rel=1e-3)
    assert parts["boat's position"][0] == pytest.approx(math.sqrt(2) * 0.3, rel=1e-3)
    assert parts["all"][0] == pytest.approx(math.hypot(*(v[0] for n, v in parts.items() if n != "all")), rel=1e-3)


def test_the_boats_position_changes_slowly(device):
    """Autocorrelation e^(-t/60 s) of what the fixes of an AUV at rest have in common."""
    _, _, world = errors_of_fixes(device, ERRORS["position"], 1)
    first = world.boat[..., BoatColumn.span("gnss_x", "gnss_y")].clone()
    for _ in range(30):
        world.step(torch.zeros(WORLDS, 2, 2, device=device))
    later = world.boat[..., BoatColumn.span("gnss_x", "gnss_y")]
    correlation = torch.corrcoef(torch.stack([first.flatten(), later.flatten()]))[0, 1].item()
    assert correlation == pytest.approx(math.exp(-30 / 60), abs=4 / math.sqrt(2 * WORLDS))
    assert later.std().item() == pytest.approx(0.5, rel=0.05)


def test_a_fast_boat_hears_less(device):
    """Its noise, 20 dB over the sea's at top speed, falls by 60 dB a decade of speed."""
    loud = ["boat.noise_level=80", "acoustics.wind=10"]
    link = link_table(Site(Scenario.load("ideal", [*QUIET, *loud])))
    sea = coates(15000.0, 0.5, 10.0)
    assert link[0, acoustic_link.OWN_NOISE] == pytest.approx(10 ** ((80 - sea) / 10), rel=1e-4)
    out = torch.empty(3, device=device)
    table = torch.from_numpy(link).to(device)

    @ti.kernel
    def losses(link: ti.types.ndarray(dtype=ti.f32, ndim=2), out: ti.types.ndarray(dtype=ti.f32, ndim=1)):
        for n in range(1):
            for i in ti.static(range(3)):
                out[n + i] = acoustic_link.further_loss(link, 0, vec3(30.0, 40.0, -100.0), 0.1 * 10.0 ** (0.5 * i))

    losses(table, out)
    ratio = 10 ** ((80 - sea) / 10)
    assert out.cpu().numpy() == pytest.approx(
        [10 * math.log10(1 + ratio * v**6) for v in (0.1, 0.1**0.5, 1.0)], rel=1e-3
    )


def test_the_storm_sets_the_wind():
    """Sea state 7 has 15 to 20 m/s; without a storm the wind is 0 unless it is given."""

    def ratio(scenario, wind):
        changed = Scenario.load(scenario, [*QUIET, f"acoustics.wind={wind}"])
        return link_table(Site(changed))[0, acoustic_link.RATIO_AT_1M]

    assert ratio("extreme", 20) < ratio("extreme", "storm") < ratio("extreme", 15)
    assert ratio("ideal", "storm") == ratio("ideal", 0)


class TestEnergy:
    """E/N0 decides: a tone's length counts, the receiver's band and sampling rate do not."""

    @staticmethod
    def deviation(device, **settings):
        """Standard deviation of a phase difference of an AUV 100 m below, rad."""
        sonar = acoustic_link.Sonar(**{"noise_law": "density", "signal": "tone", "source_level": 160.0, **settings})
        link = torch.from_numpy(acoustic_link.link_table((15000.0,), sonar)).to(device)
        place = torch.tensor([[0.0, 0.0, -100.0]], device=device)
        none = place.new_zeros(1, 5)
        return usbl.fixes(link, none[:, 0].int(), place, none[:, :2].contiguous(), none)[0][0, 3].item()

    def test_sampling_faster_brings_nothing(self, device):
        reference = self.deviation(device)
        for settings in ({"sampling_rate": 96e3}, {"sampling_rate": 32e6}, {"bandwidth": 5000.0}):
            assert self.deviation(device, **settings) == pytest.approx(reference, rel=1e-6)
        assert self.deviation(device, periods=40.0) == pytest.approx(reference / 2, rel=1e-5)

    def test_least_squares_on_a_sampled_tone(self):
        """Noise of a density N0 has the variance N0 f_s/2 in each sample: the phase's is 1/(2 E/N0) at any rate."""
        random = np.random.default_rng(4)
        for rate in (96e3, 480e3):
            n = round(10 / 15000 * rate)
            energy_ratio = 400.0
            sigma = math.sqrt((10 / 15000 / 2) / energy_ratio * rate / 2)  # E = T/2 of a tone of amplitude 1
            angle = 2 * np.pi * 15000 / rate * np.arange(n)
            tones = np.cos(angle) + sigma * random.standard_normal((20000, n))
            phase = np.angle(tones @ np.exp(-1j * angle))
            assert phase.var() == pytest.approx(1 / (2 * energy_ratio), rel=0.06)

    def test_table_1_gives_no_fix(self, device):
        """Its 135 dB by echo at 100 m: the variance is 504 times that of noise of 10^(−SNR/20) of the amplitude in each
        of 1344 samples, and the energy is below the threshold.
        """
        table_1 = {"path": "echo", "source_level": 135.0, "bandwidth": 1000.0, "spreading": 15.0}
        right = self.deviation(device, **table_1)
        noise = sonar.noise_level(coates(15e3, 0.5, 0.0), 1000.0)
        snr = sonar.echo_snr(135.0, 3.0, noise, 100.0, 15e3)
        assert right**2 / (4 * 10 ** (-snr / 10) / 1344) == pytest.approx(504, rel=0.01)
        link = torch.from_numpy(
            acoustic_link.link_table((15000.0,), acoustic_link.Sonar(noise_law="density", **table_1))
        )
        place = torch.tensor([[0.0, 0.0, -100.0]], device=device)
        index, level = torch.zeros(1, dtype=torch.int32, device=device), place.new_zeros(1, 2)
        assert reception(link.to(device), index, place, level)[2].item() < 0.05
