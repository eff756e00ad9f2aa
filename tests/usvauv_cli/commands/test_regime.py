"""Whether what a scenario simulates occurs at sea: each check on either side of its limit, and how commands say it."""

import math

import pytest

from tests.usvauv_cli.sweep.work import Here
from usvauv.cli.sweep import perform
from usvauv.env import Scenario
from usvauv.env.scenario.fields import classes_of
from usvauv.env.world import regime

POOL = ["sea.forced_edge=east", "sea.irregular_rms=2", "sea.forcing=elevation", "sea.radiating_edges=[]"]
DEEP = ["area.depth=6000", "auv.depth=5900"]
SOUND = ["nodes.frequency=20000", "nodes.bandwidth=10000"]


def verdicts(*settings, scenario="ideal"):
    found = regime.check(Scenario.load(scenario, list(settings)))
    return {each.field: each for each in found if each.verdict != "fine"}


@pytest.mark.parametrize("name", Scenario.shipped())
def test_what_ships_occurs(name):
    found = regime.check(Scenario.load(name))
    assert {each.verdict for each in found} <= {"fine", "convention"}
    assert name.startswith("paper") == any(each.verdict == "convention" for each in found)


def test_a_quarter_wave_pool_resonates():
    """600 m at 120 m: 4L/c = 69.9 s, and at 75 s |1/cos kL| = 9.6; a wave that leaves has no gain."""
    area = ["area.width=600", "area.length=600"]
    found = verdicts(*area, *POOL)["sea.irregular_period_min"]
    gain = abs(1 / math.cos(2 * math.pi * 600 / (75 * math.sqrt(9.81 * 120))))
    assert found.verdict == "warning"
    assert f"by a factor of {gain:.3g} at a period of 75 s" in str(found)
    assert "sea.irregular_period_min" not in verdicts(*area, *POOL, "sea.irregular_period_min=160")
    leaves = ["sea.forcing=incident", "sea.radiating_edges=['west']"]
    assert "sea.irregular_period_min" not in verdicts(*area, *POOL, *leaves)


def test_the_gain_counts_in_the_height():
    """8 m at the edge are 0.067 of the depth and 9.4 times that at the wall; with less drag more."""
    area = ["area.width=600", "area.length=600"]
    found = verdicts(*area, *POOL, "sea.drag=0.002")["sea.equations"]
    assert found.verdict == "warning"
    assert float(found.value) == pytest.approx(9.4 * 8 / 120, rel=0.03)
    assert "sea.equations" not in verdicts(*area, *POOL, "sea.irregular_period_min=160")


def test_a_command_names_all_for_which_no_mission_is_possible(run_usvauv):
    """A source that nobody hears, and a current that carries the boat off."""
    settings = ["--set", "acoustics.source_level=90", "--set", "current.speed=9"]
    code, stdout, stderr = run_usvauv("simulate", *settings)
    assert (code, stdout) == (2, "")
    assert "error: extreme: acoustics.source_level: replies can be decoded up to" in stderr
    assert "error: extreme: boat.top_speed: current at the surface, median" in stderr


def test_a_study_warns_once_for_all_its_runs(run_usvauv, tmp_path, monkeypatch):
    monkeypatch.setattr(perform, "Local", lambda jobs, cores: Here())
    study = tmp_path / "study.toml"
    runs = '[common]\nscenario = "extreme"\nset = ["mission.duration=2", "storm.peak_period=8"]\n'
    study.write_text(runs + '[[runs]]\npolicy = ["straight:1.3", "straight:1.4"]\n[evaluation]\nepisodes = 1\n')
    code, _, err = run_usvauv("sweep", study, "--out", tmp_path / "done")
    assert (code, err.count("warning: storm.peak_period: ")) == (0, 1)
    study.write_text(study.read_text().replace("storm.peak_period=8", "acoustics.source_level=90"))
    assert run_usvauv("sweep", study, "--out", tmp_path / "never")[0] == 2


@pytest.mark.parametrize(
    ("settings", "field", "verdict"),
    [
        (
            ["sea.forced_edge=east", "sea.irregular_rms=1", "sea.irregular_period_min=40"],
            "sea.irregular_period_min",
            "warning",
        ),
        (["sea.forced_edge=east", "sea.regular_amplitude=20"], "sea.equations", "warning"),
        (["storm.spectrum=jonswap", "storm.peak_period=8"], "storm.peak_period", "warning"),
        (
            ["storm.spectrum=jonswap", "boat.response_time=0", "boat.windage=0", "boat.dead_band=0"],
            "boat.response_time",
            "warning",
        ),
        (["current.count=4", "current.circulation_max=600", "boat.top_speed=4"], "auv.speed_max", "warning"),
        (
            [
                "current.count=16",
                "current.core_radius_min=80",
                "current.core_radius_max=80",
                "current.circulation_min=900",
                "current.circulation_max=900",
            ],
            "auv.speed_max",
            "error",
        ),
        ([*SOUND, "nodes.rate_law=shannon"], "nodes.rate_law", "warning"),
        (["nodes.rate_law=optical", "nodes.attenuation=50"], "nodes.rate_law", "error"),
        (["acoustics.source_level=90"], "acoustics.source_level", "error"),
        # At 60 kHz the sea is quieter than at 12 kHz, and absorption silences one of the two AUVs.
        ([*DEEP, "usbl.carriers=[12000,60000]"], "acoustics.source_level", "warning"),
        ([*DEEP, "usbl.carriers=[60000,60000]"], "acoustics.source_level", "error"),
    ],
)
def test_what_does_not_occur(settings, field, verdict):
    assert verdicts(*settings)[field].verdict == verdict


def test_a_reply_is_stated_with_its_length_and_energy():
    """Bits of 2 kbit/s in 4 kHz need 4.5 dB, twenty in a pulse of 10 ms 13 dB more; at 40 bit/s the pulse needs 9."""
    for rate, said in ((2000, "lasts 78 ms and needs an E/N0 of 17.5 dB"), (400, "350 ms"), (40, "of 9.03 dB")):
        found = regime.check(Scenario.load("ideal", [f"channel.bit_rate={rate}"]))
        assert said in next(str(each) for each in found if each.field == "channel.bit_rate")
    # Uncoded bits need 11 dB more, which replies that are heard 208 m away do not have at 100 m.
    assert verdicts("channel.bit_rate=8000", scenario="wide")["acoustics.source_level"].verdict == "error"
    assert not any(each.field.startswith("channel") for each in regime.check(Scenario.load("paper-ideal")))


# Eight AUVs, up to 300 m away: 0.4 s there and back, 0.1 s at the AUV and pulses of 0.01 s.
@pytest.mark.parametrize(
    ("schedule", "field", "fine", "warns"),
    [
        ("slots", "channel.bit_rate", 61, 60),  # 8 · 88 bit and 8 · 136, 9 pulses
        ("all", "channel.bit_rate", 29, 28),  # 8 · 88 bit and 136, 2 pulses
        ("turns", "channel.turn_around", 3.2, 3.3),  # eight times it, 0.4 s, 88 bit and 136 at 2 kbit/s, 2 pulses
        ("slots", "channel.interval", 30, 30.1),
        ("turns", "channel.interval", 3.75, 3.8),
    ],
)
def test_an_auv_has_a_fix_in_30_s(schedule, field, fine, warns):
    for value, verdict in ((fine, "fine"), (warns, "warning")):
        changes = ["auv.count=8", f"channel.schedule={schedule}", f"{field}={value}"]
        found = [each for each in regime.check(Scenario.load("ideal", changes)) if each.value.endswith(" s")]
        (waits,) = (each for each in found if each.field in ("channel.schedule", "channel.interval"))
        assert (waits.verdict, waits.field == "channel.interval") == (verdict, field == "channel.interval")


def test_replies_at_once_need_a_low_rate_and_like_ranges():
    """Bits of 1 kbit/s in 4 kHz are read with 1.5 dB less than the others. A deep team has 0.4 dB less, and with three
    AUVs 3 dB more; below 100 m, 20 log10 2.095 and 0.3 dB by absorption.
    """
    deep = ["channel.schedule=all", "channel.bit_rate=1000", "area.depth=1100", "auv.depth=1000"]
    found = [verdicts(*deep, *more).get("channel.schedule") for more in ([], ["auv.count=3"], ["auv.depth=100"])]
    assert [each and each.value for each in found] == [None, "-3.4 dB", "-6.7 dB"]
    assert "1.5 dB" in verdicts("channel.schedule=all")["channel.schedule"].limit
    assert "channel.schedule" not in verdicts("channel.schedule=all", "channel.bit_rate=0")


CALM = ["storm.spectrum=jonswap", "storm.significant_height=1.2", "storm.peak_period=5"]
OWN = [f"boat.{field}={value}" for field, value in classes_of("boat")["otter"]["boat"].items()]
OTTER = ["boat.vessel=otter", *OWN, *CALM, "usbl.array_depth=0.5"]


@pytest.mark.parametrize(
    ("settings", "field", "said"),
    [
        (
            ["storm.significant_height=1.3"],
            "boat.wave_limit",
            "significant height 1.3 m; the boat works in at most 1.25 m",
        ),
        (["acoustics.wind=12"], "boat.wind_limit", "wind 12 m/s; the boat works in at most 10.7 m/s"),
        (["usbl.array_depth=0.1"], "usbl.array_depth", "0.1 m; must be more than the boat's draught, 0.195 m"),
        (["boat.top_speed=4"], "boat.vessel", "other numbers than otter: boat.top_speed = 4.0, not 3.1"),
    ],
)
def test_a_boat_where_it_does_not_belong(settings, field, said):
    assert not verdicts(*OTTER)
    found = verdicts(*OTTER, *settings)[field]
    assert found.verdict == "warning"
    assert said in str(found)


@pytest.mark.parametrize(
    ("settings", "field", "said"),
    [
        (["auv.depth=98"], "auv.depth_rating", ""),
        (["auv.depth=99.8"], "auv.depth_rating", "come as deep as 100.4 m; must not exceed the rated depth, 100 m"),
        (
            ["auv.battery=30", "reference.straight_speed=1.6"],
            "auv.battery",
            "lasts for 0.257 h at 2.5 m/s and 0.626 h at 1.6 m/s; must last for the",
        ),
        (["auv.speed_max=2", "torpedo.hotel=9"], "auv.vehicle", "speed_max = 2.0, not 2.5; torpedo.hotel = 9.0, not"),
    ],
)
def test_an_auv_of_a_class_is_held_to_its_numbers(settings, field, said):
    found = verdicts("auv.vehicle=remus-100", *settings).get(field)
    assert (found is not None) == bool(said)
    assert said in str(found or "")
    plain = regime.check(Scenario.load("paper-ideal"))
    assert not {each.field for each in plain} & {"auv.depth_rating", "auv.battery", "auv.vehicle"}


def test_the_depth_of_vehicles_is_that_over_the_bed_which_they_follow():
    """A run of `wide-torpedo`, 20 m above a bed of 120 ± 4 m, reached 109.7 m."""
    found = verdicts("area.depth=120", scenario="wide-torpedo")["auv.depth_rating"]
    assert 109.7 < float(found.value.split()[0]) < 111


@pytest.mark.parametrize("law", ["modem", "optical"])
def test_what_modems_carry_occurs(law):
    assert not verdicts(f"nodes.rate_law={law}")


def test_check_prints_all(run_usvauv):
    code, out, err = run_usvauv("scenarios", "wide", "--check", "--set", "nodes.rate_law=shannon", *_set(SOUND))
    assert (code, err) == (0, "")
    assert "warning     nodes.rate_law: the data link carries" in out
    assert out.count("fine  ") > 2


def test_an_error_ends_with_2(run_usvauv):
    assert run_usvauv("scenarios", "ideal", "--check", "--set", "acoustics.source_level=90")[0] == 2
    assert run_usvauv("scenarios", "--check")[0] == 2


def test_commands_warn_once_and_refuse(run_usvauv, tmp_path):
    command = ["eval", "extreme", "--episodes", "1", "--policy", "straight", "--out", str(tmp_path / "x.csv")]
    code, out, err = run_usvauv(*command, *_set(["mission.duration=2", "storm.peak_period=8"]))
    assert (code, err.count("warning: storm.peak_period: ")) == (0, 1)
    assert "warning" not in out
    code, _, err = run_usvauv(*command, "--force", "--set", "acoustics.source_level=90")
    assert code == 2
    assert "acoustics.source_level: replies can be decoded up to" in err


def _set(settings):
    return [part for setting in settings for part in ("--set", setting)]


def test_messages_of_ranges_leave_time_for_fixes():
    """Each takes 2.6 s every 10 s: those of three AUVs do, those of three AUVs and a boat do not."""
    long, field = "task_parameters.message_time=2.6", "task_parameters.message_time"
    assert verdicts(long, scenario="tracking")[field].verdict == "error"
    assert field not in verdicts(long, "task_parameters.boat_listens=0", scenario="tracking")
