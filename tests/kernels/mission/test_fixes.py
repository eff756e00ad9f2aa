"""Fixes in a mission: late ones, lost ones, bent rays, tones."""

import math

import numpy as np
import pytest
import torch

from tests.links import TILTING
from usvauv import policies
from usvauv.env import Scenario, ScenarioError, World
from usvauv.env.record.recorder import record
from usvauv.kernels.positioning import usbl

PLAIN = [*TILTING, "observation.current=vector"]  # compiles faster than a profile in depth
LOUD = ["acoustics.source_level=230", "usbl.attitude_error=0", "usbl.tilt=false"]
THERMOCLINE = "acoustics.sound_speed_profile=[[0, 1522], [20, 1522.3], [50, 1492], [200, 1490]]"


def steady(observation):
    """Always the same way, at the top speed."""
    return torch.tensor([0.6, -0.8]).expand(*observation.shape[:2], 2)


def voyage(settings, *, worlds=32, steps=40, seed=1, usv="centroid", policy=None):
    scenario = Scenario.load("extreme", [f"mission.duration={steps}", *PLAIN, *settings])
    world = World(scenario, worlds, seed, usv)
    act = policies.load(policy, world).act if policy else steady
    return record(world, act, policy or "steady")


def column(trace, name):
    return getattr(trace, name).astype(float)


class TestLate:
    @pytest.mark.parametrize("propagates", [False, True])
    def test_a_fix_is_of_where_the_auv_was(self, propagates):
        """Without noise the error is minus the way made meanwhile, however the boat has moved."""
        trace = voyage([*LOUD, f"usbl.propagation={str(propagates).lower()}"])
        place = column(trace, "auv_position")
        moved = np.diff(place, axis=0)
        going = (np.abs(moved).sum(-1) > 0.2) & (trace.border[1:] == 0) & (trace.hovering[1:] == 0)
        away = place - column(trace, "boat_position")
        separation = trace.scenario.auv.depth + column(trace, "boat_surface")[..., 0]
        S = np.sqrt((away**2).sum(-1) + separation**2)
        expected = -(propagates * S / 1500)[1:, ..., None] * moved
        error = (column(trace, "fix") - place)[1:]
        assert going.sum() > 500
        np.testing.assert_allclose(error[going], expected[going], atol=3e-3)
        np.testing.assert_allclose(column(trace, "fix"), column(trace, "heard_position"), atol=3e-3)


class TestAttitude:
    def errors(self, *settings):
        """Fix minus place (T, W, K, 2) without noise or delay, and the vertical separation (T, W, 1), m."""
        trace = voyage(["acoustics.source_level=230", "usbl.propagation=false", *settings])
        separation = trace.scenario.auv.depth + column(trace, "boat_surface")[..., 0]
        return (column(trace, "estimate") - column(trace, "auv_position"))[1:], separation[1:]

    def test_a_known_tilt_leaves_no_error(self):
        error, _ = self.errors("usbl.tilt=true", "usbl.attitude_error=0")
        assert np.abs(error).max() < 0.02

    def test_what_is_left_of_it_turns_the_array_and_all_fixes_with_it(self):
        """A small turn by ε moves what lies z below by ε z, each axis alike, whatever its horizontal offset."""
        error, separation = self.errors("usbl.tilt=false", "usbl.attitude_error=0.01")
        assert np.abs(error[:, :, 0] - error[:, :, 1]).max() < 0.1
        angle = error[:, :, 0] / separation
        count = angle[..., 0].size
        for axis in range(2):
            assert angle[..., axis].std() == pytest.approx(0.01, rel=5 / math.sqrt(2 * count))
            assert abs(angle[..., axis].mean()) < 5 * 0.01 / math.sqrt(count)
        assert abs(np.corrcoef(angle.reshape(-1, 2).T)[0, 1]) < 5 / math.sqrt(count)


class TestLost:
    def test_the_share_and_what_is_left(self):
        trace = voyage(["usbl.packet_loss=0.3"], worlds=64)
        lost = trace.fix_flags == usbl.LOST
        n = lost.size
        assert abs(lost.mean() - 0.3) < 4 * math.sqrt(0.21 / n)
        assert ((trace.fix_flags == usbl.DETECTED) | lost).all()
        assert (np.isnan(trace.fix).all(-1) == lost).all()
        # The estimate stays, or is the fix.
        np.testing.assert_array_equal(trace.estimate[1:][lost[1:]], trace.estimate[:-1][lost[1:]])
        np.testing.assert_array_equal(trace.estimate[~lost], trace.fix[~lost])
        np.testing.assert_array_equal(trace.estimate_covariance[~lost], trace.fix_covariance[~lost])
        both = lost[..., 0].astype(float), lost[..., 1].astype(float)
        assert abs(np.corrcoef(both[0].ravel(), both[1].ravel())[0, 1]) < 5 / math.sqrt(n / 2)

    def test_other_draws_do_not_move(self):
        """Losing fixes changes no other random number: nodes, vortices and the fixes that remain are the same."""
        whole, holed = voyage([]), voyage(["usbl.packet_loss=0.5"])
        np.testing.assert_array_equal(whole.node_position, holed.node_position)
        np.testing.assert_array_equal(whole.vortex, holed.vortex)
        heard = holed.fix_flags[0] == usbl.DETECTED
        assert 0.3 < heard.mean() < 0.7
        np.testing.assert_array_equal(whole.fix[0][heard], holed.fix[0][heard])

    def test_a_tone_too_weak_is_not_detected(self):
        trace = voyage(["acoustics.source_level=132"], worlds=4, steps=5)
        assert (trace.fix_flags & usbl.DETECTED == 0).all()
        assert np.isnan(trace.fix).all()

    def test_no_direct_ray_reaches_the_boat(self):
        """Under a layer that bends sound down steeply nothing is heard from far away."""
        shadow = "acoustics.sound_speed_profile=[[0, 1540], [100, 1500], [200, 1500]]"
        wide = ["area.width=4000", "area.length=4000", "sea.cell_size=100"]
        calm = ["storm.spectrum=none", "sea.irregular_rms=0", "sea.regular_amplitude=0"]
        trace = voyage([shadow, *wide, *calm, "acoustics.source_level=230"], usv="hold:0,0", worlds=64, steps=2)
        R = np.linalg.norm(trace.auv_position, axis=-1)
        silent = trace.fix_flags == usbl.NO_RAY
        assert silent.any()
        radius = 1540 / 0.4  # of the arc that is horizontal at the surface
        np.testing.assert_array_equal(silent, math.sqrt(2 * radius * 100 - 100**2) < R)


class TestSound:
    def test_bent_rays_do_not_bias_fixes(self):
        """Also where the array is tilted: they are off by less than 2e-5 of the range."""
        point = ["boat.vessel=none", "boat.dead_band=0"]
        trace = voyage([THERMOCLINE, *LOUD, *point, "usbl.tilt=true", "usbl.propagation=false"], usv="hold:0,0")
        away = column(trace, "auv_position")
        R = np.linalg.norm(away, axis=-1)
        assert (np.linalg.norm(column(trace, "fix") - away, axis=-1) / R)[R > 60].max() < 2e-5

    @pytest.mark.parametrize(
        ("settings", "message"),
        [
            (["acoustics.sound_speed_profile=[[0, 1500], [90, 1490]]"], "sound_speed_profile: last depth 90 m"),
            (["acoustics.sound_speed_profile=[[0, 4900]]"], "sound_speed_profile: speed 4900 m/s at 0 m; allowed"),
            ([THERMOCLINE, "acoustics.temperature_salinity=[[0, 10, 35], [200, 9, 35]]"], "give one of them"),
            (["acoustics.temperature_salinity=[[0, 283, 35], [200, 9, 35]]"], "temperature_salinity: temperature 283"),
        ],
    )
    def test_bad_settings_are_one_line(self, settings, message):
        pytest.importorskip("gsw")
        with pytest.raises(ScenarioError) as caught:
            World(Scenario.load("extreme", [*PLAIN, *settings]), 1)
        assert message in str(caught.value)
        assert "\n" not in str(caught.value)


def test_errors_in_units_of_the_predicted_covariance_are_chi_square():
    """Over a whole mission."""
    trace = voyage(["usbl.attitude_error=0", "usbl.propagation=false"], worlds=64)
    error = (column(trace, "fix") - column(trace, "auv_position")).reshape(-1, 2)
    C = column(trace, "fix_covariance").reshape(-1, 3)[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    squared = np.einsum("ni,nij,nj->n", error, np.linalg.inv(C), error)
    assert squared.mean() == pytest.approx(2, abs=5 * math.sqrt(4 / len(squared)))
