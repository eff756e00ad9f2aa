"""Metrics against numbers worked out by hand, and the trace's way through a file."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
import xarray

from tests.links import EVERY_STEP
from usvauv import policies
from usvauv.env import Scenario, Trace, TraceError, World
from usvauv.env.record.metrics import COLUMNS, energy_consumption, episode_metrics, usable
from usvauv.env.record.recorder import record
from usvauv.env.record.trace import VARIABLES
from usvauv.env.storage.tables import read_rows, write_rows
from usvauv.kernels.positioning import usbl


def small_trace() -> Trace:
    """Four steps, one world, two AUVs, one node; every figure can be worked out on paper."""
    steps, worlds, auvs, nodes, terms = 4, 1, 2, 1, 2
    sizes = {
        "time": steps, "world": worlds, "auv": auvs, "boat": 1, "node": nodes, "axis": 2, "component": 3,
        "reward_term": terms, "surface_component": 3, "vortex": 0, "vortex_parameter": 4, "stream_time": 0,
        "stream_y": 0, "stream_x": 0, "y": 0, "x": 0,
    }  # fmt: skip
    arrays = {name: np.zeros([sizes[d] for d in about.dimensions]) for name, about in VARIABLES.items()}
    arrays["surface"] = np.zeros((0, 0, 0))
    arrays["fix_flags"] = arrays["fix_flags"].astype(np.uint8)
    arrays["time"] = np.array([2.0, 4.0, 6.0, 8.0])
    arrays["power"][:, 0] = [[60, 100], [60, 100], [105, 100], [60, 100]]
    arrays["hovering"][2, 0, 0] = 1
    arrays["service_rate"][2, 0, 0] = 0.25
    arrays["service_rate"][3, 0, 1] = 0.5
    arrays["delivered"][2, 0, 0] = 1.5
    arrays["delivered"][3, 0, 1] = 2.0
    arrays["reward_terms"][:, 0, :, 0] = [[1, 2], [1, 2], [1, 2], [1, 2]]
    arrays["reward_terms"][0, 0, 0, 1] = -8
    arrays["overflowing"][:, 0] = [0, 1, 3, 0]
    arrays["collisions"][1, 0] = 1
    arrays["border"][0, 0, 1] = 1
    arrays["estimate"][:, 0, 0] = [[3, 4], [0, 0], [0, 0], [0, 0]]
    arrays["estimate"][:, 0, 1] = [[0, 1], [0, 1], [0, 1], [0, 1]]
    arrays["fix"][:, 0, 0] = [[6, 8], [0, 3], [np.nan, np.nan], [0, 7]]
    arrays["fix"][:, 0, 1] = [[0, 1], [0, 2], [0, 50], [0, 4]]
    arrays["fix_flags"][:, 0, 0] = [1, 1, 0, 1]  # one is not heard
    arrays["fix_flags"][:, 0, 1] = [1, 1, 3, 1]  # one has wrapped
    arrays["node_position"][0, 0] = [0, 7]
    arrays["auv_position"][:, 0, 1] = [[3, 3], [3, 3], [0, 7], [0, 6]]
    arrays["estimate"][:, 0, 1] += arrays["auv_position"][:, 0, 1]
    arrays["own_position"][:, 0, 0] = [[0, 2], [0, 2], [0, 0], [0, 0]]
    arrays["own_position"][:, 0, 1] = arrays["auv_position"][:, 0, 1]
    arrays["heard_position"][:, 0, 1] = arrays["auv_position"][:, 0, 1] - 1  # its signal took its time
    arrays["fix"][:, 0, 1] += arrays["heard_position"][:, 0, 1]
    scenario = Scenario.from_dict({"name": "paper sheet", "mission": {"step": 2.0, "duration": 8.0}})
    return Trace(scenario=scenario, policy="p", usv="fim", seed=3, reward_names=("a", "b"), start="", **arrays)


def test_metrics_by_hand():
    (row,) = episode_metrics(small_trace(), first_episode=7)
    assert (row.scenario, row.policy, row.usv, row.seed, row.episode) == ("paper sheet", "p", "fim", 3, 7)
    assert row.sdr == pytest.approx(0.75)
    # AUV 0: (60 + 60 + 105 + 60) W · 2 s over 8 − 2 s; AUV 1: 100 W over all 8 s.
    assert row.ec == pytest.approx((285 * 2 / 6 + 100) / 2)
    assert row.arps == pytest.approx((3 * 4 - 8) / 4)
    assert row.services == 2
    assert row.delivered_mbit == pytest.approx(3.5)
    assert row.energy_wh == pytest.approx((285 + 400) * 2 / 3600)
    assert (row.overflow, row.collisions, row.border) == (4, 1, 1)
    assert row.position_error_mean == pytest.approx((5 + 4) / 8)
    assert row.position_error_median == pytest.approx(1)
    assert row.target_distance == pytest.approx((4 * 7 + 5 + 5 + 0 + 1) / 8)
    assert row.position_error_rms == pytest.approx(math.sqrt((25 + 4) / 8))
    assert row.own_error_mean == pytest.approx(4 / 8)
    assert row.own_error_rms == pytest.approx(1)
    # Sorted 0 0 0 1 1 1 1 5; the 95th percentile lies at 0.95 · 7 = 6.65 of the way from the first to the last.
    assert row.position_error_p95 == pytest.approx(1 + 0.65 * 4)


class TestFixes:
    """AUV 0 is unheard in one step; AUV 1 has a wrapped fix, 50 m off, which the receiver cannot tell."""

    def test_errors_and_availability_by_hand(self):
        (row,) = episode_metrics(small_trace())
        # Usable: 10, 3, 7 m of AUV 0 and 1, 2, 50, 4 m of AUV 1, sorted 1 2 3 4 7 10 50.
        assert row.fix_error_mean == pytest.approx(77 / 7)
        assert row.fix_error_median == 4
        assert row.fix_error_rms == pytest.approx(math.sqrt((1 + 4 + 9 + 16 + 49 + 100 + 2500) / 7))
        assert row.fix_error_p95 == pytest.approx(10 + 0.7 * 40)
        assert row.fix_availability == pytest.approx(7 / 8)
        assert row.fix_wrapped == pytest.approx(1 / 7)
        assert row.outage_longest == 2

    @pytest.mark.parametrize(
        ("flags", "is_usable"),
        [
            (usbl.DETECTED, True),
            (usbl.DETECTED | usbl.WRAPPED, True),
            (usbl.DETECTED | usbl.NO_DEPTH, False),
            (usbl.DETECTED | usbl.NO_DEPTH | usbl.WRAPPED, False),
            (usbl.WRAPPED, False),
            (usbl.NO_RAY, False),
            (usbl.LOST, False),
            (usbl.DETECTED | usbl.AMBIGUOUS, False),
            (usbl.DETECTED | usbl.REJECTED, False),
            (usbl.SILENT, False),
            (0, False),
        ],
    )
    def test_what_a_receiver_can_use(self, flags, is_usable):
        trace = small_trace()
        trace.fix_flags[1, 0, 0] = flags
        (row,) = episode_metrics(trace)
        assert row.fix_availability == pytest.approx((6 + is_usable) / 8)
        assert row.outage_longest == (2 if is_usable else 4)  # step 2 is one without a fix anyway

    def test_the_longest_outage_is_that_of_one_auv(self):
        """Outages of different AUVs do not add up, and one at the end counts."""
        trace = small_trace()
        trace.fix_flags[:, 0, 0] = [0, 0, 1, 1]
        trace.fix_flags[:, 0, 1] = [1, 0, 0, 0]
        (row,) = episode_metrics(trace)
        assert row.outage_longest == 6
        assert row.fix_availability == pytest.approx(3 / 8)

    def test_an_episode_without_fixes_has_no_error_of_them(self):
        trace = small_trace()
        trace.fix_flags[:] = usbl.LOST
        trace.fix[:] = np.nan
        (row,) = episode_metrics(trace)
        assert (row.fix_availability, row.outage_longest) == (0, 8)
        of_fixes = [row.fix_error_mean, row.fix_error_median, row.fix_error_rms, row.fix_error_p95, row.fix_wrapped]
        assert np.isnan(of_fixes).all()
        assert row.position_error_mean == pytest.approx((5 + 4) / 8)

    def test_usable_fixes_are_those_that_the_boat_uses(self):
        """Without a tracker the estimate is the last usable fix: it changes when there is one, and to it."""
        noisy = [*EVERY_STEP, "auv.count=3", "acoustics.source_level=146", "usbl.packet_loss=0.2", "usbl.spacing=0.052"]
        world = World(Scenario.load("extreme", ["mission.duration=60", *noisy]), num_worlds=4, seed=1, usv="hold:0,0")
        trace = record(world, lambda _: torch.zeros(4, 3, 2), "still")
        had = usable(trace)
        for flag in (usbl.DETECTED, usbl.NO_DEPTH, usbl.LOST, usbl.AMBIGUOUS):
            assert (trace.fix_flags & flag == flag).any()
        assert 0.1 < had.mean() < 0.9
        np.testing.assert_array_equal(trace.estimate[had], trace.fix[had])
        kept = ~had[1:]
        np.testing.assert_array_equal(trace.estimate[1:][kept], trace.estimate[:-1][kept])


def test_ec_leaves_out_the_exact_length_of_services():
    """AUV 0: 285 W · 2 s over 8 − 1.5/1.25 s; AUV 1: 400 W · 2 s over 8 − 2/0.625 s."""
    trace = small_trace()
    trace.service_rate[2, 0, 0], trace.service_rate[3, 0, 1] = 1.25, 0.625
    trace.hovering[2:, 0, 1] = 1
    exact = replace(
        trace, scenario=Scenario.from_dict(trace.scenario.to_dict() | {"nodes": {"hovering_time": "exact"}})
    )
    so_far = energy_consumption(exact)[:, 0]
    assert so_far[-1] == pytest.approx((570 / 6.8 + 800 / 4.8) / 2)
    assert so_far[2] == pytest.approx((450 / 4.8 + 600 / 4) / 2)  # AUV 1 has hovered for one step, its service goes on
    assert episode_metrics(exact)[0].ec == so_far[-1]


def test_csv_has_the_promised_columns(tmp_path):
    promised = (
        "scenario policy usv seed episode sdr ec arps services delivered_mbit energy_wh target_distance overflow "
        "collisions border position_error_mean position_error_median position_error_rms position_error_p95 "
        "own_error_mean own_error_median own_error_rms own_error_p95 "
        "fix_error_mean fix_error_median fix_error_rms fix_error_p95 fix_availability fix_wrapped fix_dropped "
        "outage_longest targets"
    )
    assert " ".join(COLUMNS) == promised
    rows = episode_metrics(small_trace())
    write_rows(tmp_path / "m.csv", list(rows[0].columns()), (row.columns() for row in rows))
    (read,) = read_rows(tmp_path / "m.csv")
    assert tuple(read) == (*COLUMNS, "lost_mbit", "aoi_mean", "aoi_peak", "aoi_largest", "jain", "joule_per_mbit")
    assert float(read["ec"]) == rows[0].ec
    assert [path.name for path in tmp_path.iterdir()] == ["m.csv"]


def test_a_table_makes_its_folder_and_takes_the_place_of_another(tmp_path):
    for number in ("1", "2"):
        write_rows(tmp_path / "a" / "b" / "m.csv", ["x"], [{"x": number}])
    assert read_rows(tmp_path / "a" / "b" / "m.csv") == [{"x": "2"}]


def test_trace_survives_its_file(tmp_path):
    scenario = Scenario.load("extreme", ["mission.duration=20"])
    world = World(scenario, num_worlds=2, seed=1)
    player = policies.load("straight", world)
    trace = record(world, player.act, "straight", surface=True)
    path = tmp_path / "t.nc"
    trace.save(path)
    again = Trace.load(path)
    assert again.scenario == scenario
    assert (again.policy, again.usv, again.seed, again.reward_names) == ("straight", "fim", 1, world.reward_names)
    for name in VARIABLES:
        np.testing.assert_array_equal(getattr(again, name), getattr(trace, name), err_msg=name)
    with xarray.open_dataset(path) as file:
        for name, variable in file.variables.items():
            if name in ("x", "y"):
                continue
            about = VARIABLES[name]
            assert (variable.attrs["long_name"], variable.attrs.get("units")) == (about.long_name, about.units)
        for variable in file.variables.values():
            variable.attrs.clear()  # as earlier versions wrote it
        file.load().to_netcdf(tmp_path / "older.nc", engine="h5netcdf")
    np.testing.assert_array_equal(Trace.load(tmp_path / "older.nc").fix, trace.fix)
    for row, as_before in zip(episode_metrics(again), episode_metrics(trace), strict=True):
        assert str(row) == str(as_before)  # numbers in full; NaN equals NaN there
    assert episode_metrics(trace.episode(1))[0].sdr == episode_metrics(trace)[1].sdr


def test_trace_agrees_with_the_reward_the_learner_sees():
    world = World(Scenario.load("extreme", ["mission.duration=50"]), num_worlds=3, seed=1)
    rewards = []

    def act(observation: torch.Tensor) -> torch.Tensor:
        rewards.append(world.reward.sum(dim=1).clone())
        return torch.zeros(3, 2, 2)

    trace = record(world, act, "still")
    rewards = torch.stack([*rewards[1:], world.reward.sum(dim=1)]).double().mean(dim=0)
    arps = [row.arps for row in episode_metrics(trace)]
    np.testing.assert_allclose(arps, rewards.numpy(), rtol=1e-5)


def test_not_a_trace(tmp_path):
    path = tmp_path / "x.nc"
    path.write_bytes(b"nothing of the kind")
    with pytest.raises(TraceError, match=r"x\.nc: not a NetCDF file"):
        Trace.load(path)
