"""Coded pulses in missions: sampled ones against their statistical model, alone and with reflections."""

import math
import re

import numpy as np
import pytest
import torch
from scipy import stats

from tests.slowly import slowly
from tests.usvauv_env.test_fix_accuracy import QUIET, WORLDS, errors_of_fixes
from usvauv.env import Scenario, ScenarioError
from usvauv.env.planning import fix_errors
from usvauv.env.planning.plan import solve
from usvauv.env.site.site import Site
from usvauv.env.world.tables import link_table
from usvauv.kernels.mission.columns import AuvColumn
from usvauv.kernels.positioning import acoustic_link, usbl

SHALLOW = ["area.width=1000", "area.length=1000", "sea.cell_size=20", "auv.depth=40", "area.depth=60"]

MELTWATER = "acoustics.sound_speed_profile=[[0,1440],[20,1475],[60,1480]]"


def fixes(device, changes):
    """Horizontal errors (n,) of good fixes, m, flags of all, and slant ranges of all, m."""
    error, _, world = errors_of_fixes(device, changes, 2)
    auv = world.auv.double().cpu().numpy()
    flags = auv[..., AuvColumn.fix_flags].astype(int).reshape(-1)
    boat = world.boat.double().cpu().numpy()[..., :2]
    away = np.linalg.norm(auv[..., :2] - boat, axis=-1).reshape(-1)
    slant = np.hypot(away, world.scenario.auv.depth)
    return np.linalg.norm(error, axis=-1)[flags == usbl.DETECTED], flags, slant


def both(device, changes):
    """`fixes` by the statistical model and by sampled pulses."""
    return [fixes(device, [*changes, f"usbl.model={model}"]) for model in ("statistical", "waveform")]


def rms(error):
    return math.sqrt(np.mean(error**2))


UNDISTURBED = {
    "104 dB": ["acoustics.source_level=104"],
    "110 dB": ["acoustics.source_level=110"],
    "150 dB": ["acoustics.source_level=150"],
    "bent": [*SHALLOW, "acoustics.source_level=160", MELTWATER],
    "slower than supposed": ["acoustics.source_level=150", "acoustics.sound_speed_error=10"],
}


@pytest.mark.parametrize(("length", "chips"), [(0.004, 16), (0.25, 1000)])
def test_the_shortest_and_the_longest_pulse(length, chips):
    changes = ["acoustics.multipath=true", "acoustics.bandwidth=4000", f"usbl.pulse_length={length}"]
    assert Scenario.load("ideal", changes).chips == chips


@pytest.mark.parametrize("case", slowly(UNDISTURBED, "bent"))
def test_errors_without_reflections(device, case):
    """The same rms within 3 %, from an E/N0 of 15 dB on, 6 dB over the threshold of detection."""
    statistical, sampled = both(device, UNDISTURBED[case])
    assert min((part[1] & usbl.DETECTED).mean() for part in (statistical, sampled)) > 0.999
    assert rms(sampled[0]) == pytest.approx(rms(statistical[0]), rel=0.03)


@pytest.mark.parametrize("level", [95.5, 97.0, 98.0])
def test_detection_near_the_threshold(device, level):
    """The sampled rate is that of noncentral χ² of 9 degrees of freedom, the statistical one within 0.05 of it."""
    changes = [f"acoustics.source_level={level}"]
    statistical, sampled = both(device, changes)
    link = link_table(Site(Scenario.load("ideal", [*QUIET, *changes])))
    ratio = link[0, acoustic_link.RATIO_AT_1M] - 20 * np.log10(sampled[2])
    ratio -= link[0, acoustic_link.ABSORPTION] * sampled[2] / 1000
    expected = stats.ncx2.sf(link[0, acoustic_link.THRESHOLD], 9, 8 * 10 ** (ratio / 10))[::2].mean()
    rate = [(part[1][::2] & usbl.DETECTED).mean() for part in (statistical, sampled)]
    assert 0.05 < expected < 0.95
    assert rate[1] == pytest.approx(expected, abs=4.5 * 0.5 / math.sqrt(WORLDS))
    assert rate[0] == pytest.approx(rate[1], abs=0.05)


REFLECTING = {
    "steep, mirror": ["acoustics.source_level=187"],
    "shallow, mirror": [*SHALLOW, "acoustics.source_level=160"],
    "shallow, breeze": [*SHALLOW, "acoustics.source_level=160", "acoustics.wind=4"],
    "shallow, clay": [*SHALLOW, "acoustics.source_level=160", "acoustics.wind=8", "acoustics.sediment=clay"],
    "shallow, bent": [*SHALLOW, "acoustics.source_level=160", "acoustics.wind=4", MELTWATER],
}


@pytest.mark.parametrize("case", slowly(REFLECTING, "shallow, bent", "steep, mirror"))
def test_errors_with_reflections(device, case):
    """The same rms within 5 %, and the same share of good fixes within 0.05, of pulses that reflections disturb."""
    statistical, sampled = both(device, [*REFLECTING[case], "acoustics.multipath=true"])
    assert rms(sampled[0]) == pytest.approx(rms(statistical[0]), rel=0.05)
    assert len(sampled[0]) / len(sampled[1]) == pytest.approx(len(statistical[0]) / len(statistical[1]), abs=0.05)
    alone = fixes(device, REFLECTING[case])[0]
    assert rms(sampled[0]) > (1.005 if case == "shallow, clay" else 1.5) * rms(alone)


@pytest.mark.slow
def test_reflections_through_water_of_one_speed_are_straight(device):
    changes = [*REFLECTING["shallow, breeze"], "acoustics.multipath=true"]
    straight = fixes(device, changes)[0]
    bent = fixes(device, [*changes, "acoustics.sound_speed_profile=[[0,1500]]"])[0]
    assert len(bent) == pytest.approx(len(straight), rel=1e-3)
    assert rms(bent) == pytest.approx(rms(straight), rel=3e-3)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (["usbl.signal=tone"], "acoustics.multipath: needs usbl.signal = code"),
        (["auv.separation=demonstration"], "acoustics.multipath: needs auv.separation = geometry"),
        (["usbl.pulse_length=0.003"], "a pulse of 12 chips; from 16 to 1000"),
        (["acoustics.sediment=mud"], "'mud': allowed are clay, silt, sand, gravel, moraine"),
    ],
)
def test_what_reflections_need(changes, words):
    with pytest.raises(ScenarioError, match=re.escape(words)):
        Scenario.load("ideal", [*QUIET, "acoustics.multipath=true", *changes])


def test_a_sampled_pulse_has_a_code():
    with pytest.raises(ScenarioError, match=r"a pulse of 12 chips; from 16 to 1000 with usbl\.model = waveform"):
        Scenario.load("ideal", [*QUIET, "usbl.model=waveform", "usbl.pulse_length=0.003"])


CALM = ["acoustics.wind=0", "auv.depth=100", "area.depth=120"]


@pytest.mark.parametrize(("wind", "sediment"), [(0, "sand"), (2, "sand"), (12, "clay"), (12, "gravel")])
def test_predicted_errors_are_those_of_missions(device, wind, sediment):
    """The closed form over many places, within 10 % where the direct sound is the strongest.

    In strong wind the surface reflects nothing; beside the direct sound there is that of a bottom 0.3 m below.
    """
    bottom = ["area.depth=100.3"] if wind > 10 else []
    water = [*CALM, *bottom, f"acoustics.wind={wind}", f"acoustics.sediment={sediment}", "acoustics.multipath=true"]
    error, _, world = errors_of_fixes(device, water, 2)
    site = Site(world.scenario)
    auv = world.auv.double().cpu().numpy()
    link = torch.from_numpy(link_table(site)).to(device)
    offset = (auv[..., :2] - world.boat.double().cpu().numpy()[..., :2]).reshape(-1, 2)
    predicted = fix_errors.reflection_errors(site, link, [(x, y, 100.0) for x, y in offset], (0.0, 0.0))
    good = auv[..., AuvColumn.fix_flags].reshape(-1) == usbl.DETECTED
    assert rms(np.linalg.norm(error, axis=-1)[good]) == pytest.approx(rms(np.array(predicted)[good]), rel=0.1)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        (["acoustics.wind=0"], True),
        (["acoustics.wind=15"], False),
        (["acoustics.wind=0", "acoustics.multipath=true"], False),
        (["acoustics.wind=0", "usbl.signal=tone"], False),
        (["acoustics.wind=0", "usbl.gnss_error=10"], False),
    ],
)
def test_who_leaves_out_what_matters_is_told(changes, expected):
    site = Site(Scenario.load("ideal", [*QUIET, *changes]))
    line = fix_errors.reflections_warning(site)
    assert ("leaves out reflections from surface and bottom" in line) == expected
    auv = site.scenario.auv
    layout = [(10.0 + 150 * k, 10.0, auv.depth) for k in range(auv.count)]
    plan, _ = solve(site.scenario, layout, [], "d", "fix")
    assert any("leaves out reflections" in warning for warning in plan.warnings) == expected
    budget = plan.optimum.budget
    assert ("reflections" in budget) == site.scenario.acoustics.multipath
    parts = [values[0] for cause, values in budget.items() if cause != "all"]
    assert budget["all"][0] == pytest.approx(math.hypot(*parts), rel=1e-3)
    if expected:
        told = next(warning for warning in plan.warnings if "leaves out" in warning)
        reflected, others = (float(number) for number in re.findall(r"by ([\d.e+-]+) m", told))
        assert reflected > others
        assert any(others == pytest.approx(error, rel=0.06) for error in budget["all"])  # two digits
