"""What is expected of fixes: ellipses and probabilities by other means, and warnings of links of a simple law."""

import math

import numpy as np
import pytest
import torch
from scipy.stats import norm

from usvauv.env import Scenario
from usvauv.env.planning.fix_errors import (
    LARGEST_VARIANCE,
    LEAST_GOOD,
    FixError,
    ellipse,
    error_budget,
    predict,
    wrap_probability,
)
from usvauv.env.planning.plan import cause, reach, reason, root_mean_square, warnings_of
from usvauv.env.site.site import Site
from usvauv.env.world.tables import link_table
from usvauv.kernels.positioning import acoustic_link


def error(**known) -> FixError:
    """Of a fix that is sure, but for what is known."""
    sure = {"range": 100.0, "major": 2.0, "minor": 1.0, "angle": 0.0, "good": 1.0, "detected": 1.0}
    rest = {"good_if_detected": 1.0, "wrapped": 0.0, "direct_ray": True, "signal_excess": 20.0}
    return FixError(**(sure | rest | known))


class TestEllipse:
    @pytest.mark.parametrize("angle", [0.3, 1.2, 2.0, 3.0])
    def test_of_axes_and_their_angle(self, angle):
        along, across = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
        covariance = 25 * np.outer(along, along) + 4 * np.outer(across, across)
        parts = [matrix[[0, 0, 1], [0, 1, 1]] for matrix in (covariance, np.linalg.inv(covariance))]
        assert ellipse(*parts) == pytest.approx((5, 2, angle))

    @pytest.mark.parametrize(
        ("variance", "strength", "expected"),
        [
            (0.99 * LARGEST_VARIANCE, 1.0, (math.sqrt(0.99 * LARGEST_VARIANCE), 1, 0)),
            (LARGEST_VARIANCE, 1.0, (None, 1, None)),
            (math.inf, 1.0, (None, 1, None)),
            (0.25, 1.0, (None, 1, None)),  # a major axis shorter than the minor one
            (4.0, 1 / LARGEST_VARIANCE, (None, None, None)),
            (4.0, math.inf, (None, None, None)),
            (4.0, math.nan, (None, None, None)),
        ],
    )
    def test_axes_without_a_bound(self, variance, strength, expected):
        found = ellipse(np.array([variance, 0.0, 0.1]), np.array([0.0, 0.0, strength]))
        assert found == pytest.approx(expected)


def test_a_phase_leaves_its_turn():
    random = np.random.default_rng(4)
    phase, sigma = random.uniform(-4, 4, (20, 2)), random.uniform(0.1, 2, 20)
    inside = norm.cdf(math.pi, phase, sigma[:, None]) - norm.cdf(-math.pi, phase, sigma[:, None])
    np.testing.assert_allclose(wrap_probability(phase, sigma), 1 - inside[:, 0] * inside[:, 1], atol=1e-12)


def test_who_is_located():
    assert error(good=LEAST_GOOD).located
    assert not error(good=LEAST_GOOD - 1e-6).located
    located = [error(major=3.0, minor=4.0), error(major=12.0, minor=0.5), error(good=0.5, major=90.0, minor=None)]
    assert root_mean_square(located) == pytest.approx(math.sqrt((9 + 16 + 144 + 0.25) / 2))
    assert root_mean_square([*located, error(major=None)]) is None
    assert root_mean_square(located[2:]) is None


@pytest.mark.parametrize(
    ("detected", "good", "wrapped", "why"),
    [
        (0.6, 0.3, 0.3, "undetected"),  # 0.4 against 0.18 and 0.24
        (0.7, 0.5, 0.45, "wrapped"),  # 0.315 against 0.3 and 0.035
        (0.7, 0.5, 0.05, "no depth"),  # 0.315 against 0.3 and 0.035
    ],
)
def test_the_largest_loss_of_three(detected, good, wrapped, why):
    assert reason(error(detected=detected, good_if_detected=good, wrapped=wrapped)) == why


@pytest.mark.parametrize(
    ("excess", "words"),
    [
        (-3.25, "level 3.2 dB below"),
        (0.0, "level only 0.0 dB above"),
        (1.5, "level only 1.5 dB above"),
        (-30.0, "level 30.0 dB below"),
        (-30.1, "level more than 30 dB below"),
    ],
)
def test_the_worst_of_a_group_is_named(excess, words):
    group = [error(signal_excess=excess, range=90.0, wrapped=0.2), error(signal_excess=9.0, range=120.0, wrapped=0.1)]
    assert cause("undetected", group) == f"not detected, {words} the threshold at 120 m"
    assert cause("wrapped", group) == "a phase has wrapped in 20.0%"


class TestRemedies:
    """Tones of a level L dB over noise at 1 m that are heard as far as 10 L m, by arrays less than half a wave wide."""

    def expect(self, link, auvs, boat):
        found = []
        for row, (x, y, depth) in zip(link.tolist(), auvs, strict=True):
            away = math.dist((x, y, depth), (*boat, 0.0))
            excess = row[acoustic_link.RATIO_AT_1M] - away / 10
            heard, wrapped = float(excess >= 0), float(row[acoustic_link.KAPPA] > math.pi)
            found.append(
                error(range=away, good=heard * (1 - wrapped), detected=heard, good_if_detected=1 - wrapped,
                      wrapped=wrapped, signal_excess=excess)
            )  # fmt: skip
        return found

    def lines(self, auvs, *changes, widths=None):
        """Array widths in half waves."""
        scenario = Scenario.load("ideal", ["usbl.spacing=0.04", f"auv.count={len(auvs)}", *changes])
        link = torch.zeros(len(auvs), acoustic_link.COLUMNS)
        link[:, acoustic_link.RATIO_AT_1M] = 10.0
        link[:, acoustic_link.KAPPA] = math.pi * torch.tensor(widths or [0.5] * len(auvs))
        return warnings_of(scenario, self.expect, link, auvs, (200.0, 50.0))

    def test_a_louder_tone_or_a_nearer_boat_for_all_of_a_group(self):
        """Heard are 95.4 m; of hundredths of 120 and of 140 m the last within it are 94.8 and 95.2 m."""
        auvs = [(200.0, 50.0, 30.0), (80.0, 50.0, 30.0), (200.0, 190.0, 30.0)]
        assert self.lines(auvs) == [
            "AUVs 2, 3 not located from the optimum, 0.0%, 0.0% of fixes good (least 90%): not detected, level 4.3 dB"
            " below the threshold at 143 m; acoustics.source_level=192 (now 187) or the boat within 94 m, horizontally,"
            " would change it"
        ]
        link = torch.full((3, acoustic_link.COLUMNS), 10.0)
        link[:, acoustic_link.KAPPA] = 1.0
        assert [reach(self.expect, link, auvs, (200.0, 50.0), k) for k in range(3)] == pytest.approx([0, 94.8, 95.2])

    @pytest.mark.parametrize(
        ("away", "level", "louder"), [(400, 190, True), (401, 190, False), (150, 225, True), (150, 226, False)]
    )
    def test_no_tone_is_louder_than_sources_are(self, away, level, louder):
        """At most 30 dB more, and 230 dB."""
        (line,) = self.lines([(200.0, 50.0, float(away))], f"acoustics.source_level={level}")
        if louder:
            remedy = f"acoustics.source_level={math.ceil(level + away / 10 - 10)} (now {level})"
        else:
            remedy = "neither 30 dB more nor a nearer boat alone"
        assert line.endswith(f"; {remedy} would change it")

    def test_an_array_half_a_wave_wide_for_all_of_a_group(self):
        auvs = [(200.0, 50.0, 20.0)] * 3
        (line,) = self.lines(auvs, widths=[1.3, 0.9, 1.7])
        assert line.startswith("AUVs 1, 3 not located from the optimum, 0.0%, 0.0% of fixes good (least 90%): a phase")
        assert line.endswith("100.0%; usbl.spacing=0.0235 (half a wavelength, now 0.04) would change it")

    def test_a_line_for_each_reason(self):
        lines = self.lines([(200.0, 50.0, 20.0), (200.0, 180.0, 20.0)], widths=[1.26, 0.5])
        assert [line[:5] for line in lines] == ["AUV 2", "AUV 1"]
        assert "usbl.spacing=0.0317 (half" in lines[1]


CAUSES = {
    "pitch and roll": "usbl.attitude_error=0.01",
    "alignment": "usbl.alignment_error=0.02",
    "heading": "usbl.heading_error=0.03",
    "speed of sound": "acoustics.sound_speed_error=8",
    "lever arm": "usbl.lever_arm_error=0.5",
    "boat's position": "usbl.gnss_error=0.7",
}


def test_the_budget_tells_causes_apart(device):
    """A cause twice as large is twice as far off, all others as before; squares add up to that of all."""
    auvs = [(60.0, 80.0, 100.0), (150.0, 20.0, 60.0)]

    def budget(changes):
        scenario = Scenario.load("ideal", ["auv.count=2", *changes])
        link = torch.from_numpy(link_table(Site(scenario))).to(device)
        found = error_budget(scenario, link, auvs, (30.0, 40.0), "fix", (0.0, 0.0))
        expected = predict(link, None, auvs, (30.0, 40.0), "fix", (0.0, 0.0))
        assert [each.range for each in expected] == pytest.approx([math.dist(auv, (30, 40, 0)) for auv in auvs])
        assert found["all"] == pytest.approx([math.hypot(each.major, each.minor) for each in expected], rel=1e-3)
        return found

    plain = budget(CAUSES.values())
    assert set(plain) == {"noise", "all", *CAUSES}
    for k in range(2):
        parts = [values[k] for name, values in plain.items() if name != "all"]
        assert plain["all"][k] == pytest.approx(math.hypot(*parts), rel=0.02)
        assert min(parts) > 0
    for cause_name, change in CAUSES.items():
        field, _, value = change.partition("=")
        doubled = budget([*CAUSES.values(), f"{field}={2 * float(value)}"])
        for name in ("noise", *CAUSES):
            expected = [(2 if name == cause_name else 1) * value for value in plain[name]]
            assert doubled[name] == pytest.approx(expected, rel=0.02), (cause_name, name)
