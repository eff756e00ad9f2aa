"""Fixes in missions: errors as large as predicted, and energy."""

import math

import numpy as np
import pytest
import torch

from tests.links import CODED
from usvauv.env import Scenario, World
from usvauv.env.accuracy import fix_errors
from usvauv.env.accuracy.fix_errors import error_budget, reception
from usvauv.env.site.site import Site
from usvauv.env.world.mission_parameters import link_table
from usvauv.kernels.mission.columns import AuvColumn
from usvauv.kernels.positioning import acoustic_link, sonar, usbl
from usvauv.kernels.positioning.sonar import coates

QUIET = [*CODED, "acoustics.spreading=20", "usbl.propagation=false", "task=station-keeping"]
# The storm with currents that are compiled as those of "ideal".
STORM = ["current.period=0", "current.decay_depth=0", "current.mutual=false", "current.viscosity=0"]
STORM += ["observation.current=vector"]
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


@pytest.mark.parametrize(("scenario", "name"), [*(("ideal", name) for name in ERRORS), ("extreme", "all")])
def test_the_covariance_is_that_of_the_errors(device, scenario, name):
    """The mean of eᵀC⁻¹e is 2: worlds draw their errors independently, the AUVs of one world share them."""
    error, C, _ = errors_of_fixes(device, [*STORM, *ERRORS[name]], 3, scenario)
    normal = np.linalg.solve(np.linalg.cholesky(C + 1e-9 * np.eye(2)), error[..., None])[..., 0]
    squares = (normal**2).sum(-1).reshape(WORLDS, 2).mean(-1)
    assert np.isfinite(squares).all()
    assert squares.mean() == pytest.approx(2, abs=4 * squares.std() / np.sqrt(WORLDS))


@pytest.mark.parametrize("slant", [50.0, 500.0])
def test_the_budget_is_the_error_of_missions(device, slant):
    """The rms of all errors together within a tenth, and each part alone as its closed form says."""
    changes = ["area.width=1000", "area.length=1000", "area.depth=60", "auv.depth=40", "sea.cell_size=20"]
    changes += ["acoustics.source_level=187", "usbl.attitude_error=0.0015", "usbl.alignment_error=0.002"]
    changes += ["usbl.heading_error=0.004", "acoustics.sound_speed_error=2", "usbl.lever_arm_error=0.05"]
    changes += ["usbl.gnss_error=0.3"]
    scenario = Scenario.load("ideal", [*QUIET, *changes])
    world = World(scenario, 40000, 6, usv="centroid")
    world.reset()
    auv = world.auv.double().cpu().numpy()
    away = np.hypot(np.linalg.norm(auv[..., :2] - world.boat.double().cpu().numpy()[..., :2], axis=-1), 40)
    near = np.abs(away / slant - 1) < 0.05
    assert near.sum() > 100
    error = np.linalg.norm(auv[..., AuvColumn.span("fix_x", "fix_y")] - auv[..., :2], axis=-1)[near]
    link = torch.from_numpy(link_table(Site(scenario))).to(device)
    d = math.sqrt(slant**2 - 40**2)
    there = [(500 + d, 500.0, 40.0)] * 2, (500.0, 500.0), "fix", (0.0, 0.0)
    parts, expected = error_budget(scenario, link, *there), fix_errors.predict(link, None, *there)
    assert [each.range for each in expected] == pytest.approx([slant] * 2)
    assert parts["all"] == pytest.approx([math.hypot(each.major, each.minor) for each in expected], rel=1e-3)
    assert math.sqrt(np.mean(error**2)) == pytest.approx(parts["all"][0], rel=0.1)
    assert parts["pitch and roll"][0] == pytest.approx(math.sqrt(2) * 0.0015 * 40, rel=1e-3)
    assert parts["alignment"][0] == pytest.approx(math.sqrt(2) * 0.002 * 40, rel=1e-3)
    assert parts["heading"][0] == pytest.approx(0.004 * d, rel=1e-3)
    assert parts["speed of sound"][0] == pytest.approx(2 * 2 / 1500 * d, rel=1e-3)
    assert parts["lever arm"][0] == pytest.approx(math.sqrt(2) * 0.05, rel=1e-3)
    assert parts["boat's position"][0] == pytest.approx(math.sqrt(2) * 0.3, rel=1e-3)
    assert parts["all"][0] == pytest.approx(math.hypot(*(v[0] for n, v in parts.items() if n != "all")), rel=1e-3)


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

    def test_table_1_gives_no_fix(self, device):
        """Its 135 dB by echo at 100 m: the variance is 504 times that of noise of 10^(−SNR/20) of the amplitude in each
        of 1344 samples, and the energy is below the threshold.
        """
        table_1 = {"path": "echo", "source_level": 135.0, "bandwidth": 1000.0, "spreading": 15.0}
        right = self.deviation(device, **table_1)
        noise = sonar.noise_level(coates(15e3, 0.5, 0.0), 1000.0)
        snr = 135.0 - 2 * sonar.path_loss(100.0, 15.0, sonar.thorp(15e3)) + 3.0 - noise
        assert right**2 / (4 * 10 ** (-snr / 10) / 1344) == pytest.approx(504, rel=0.01)
        link = torch.from_numpy(
            acoustic_link.link_table((15000.0,), acoustic_link.Sonar(noise_law="density", **table_1))
        )
        place = torch.tensor([[0.0, 0.0, -100.0]], device=device)
        index, level = torch.zeros(1, dtype=torch.int32, device=device), place.new_zeros(1, 2)
        assert reception(link.to(device), index, place, level)[2].item() < 0.05
