"""Scenarios: what ships, what is refused and how."""

import tomllib
from importlib import resources

import pytest

from tests.trials.scenarios import numbers
from usvauv_env import Scenario, ScenarioError
from usvauv_env.sections import TaskParameters


@pytest.mark.parametrize("name", Scenario.shipped())
class TestShipped:
    def test_file_states_and_explains_every_field(self, name):
        """The file is what `to_toml` prints: nothing is left to a default, each field has its comment."""
        text = (resources.files("usvauv_env") / "scenarios" / f"{name}.toml").read_text(encoding="utf-8")
        assert text == Scenario.load(name).to_toml()
        fields = [line for line in text.splitlines() if line and not line.startswith("[")]
        assert all("  # " in line and line.split("  # ")[1].strip() for line in fields)

    def test_named_as_its_file(self, name):
        assert Scenario.load(name).name == name


def test_these_ship():
    assert Scenario.shipped() == [
        "extreme",
        "ideal",
        "paper-extreme",
        "paper-ideal",
        "station-keeping",
        "survey",
        "wide",
    ]


@pytest.mark.parametrize("name", ["paper-ideal", "paper-extreme"])
def test_table_1(name):
    """Table 1 of the paper, value by value."""
    s = Scenario.load(name)
    assert (s.area.width, s.area.length, s.area.depth) == (200, 200, 120)
    assert s.acoustics.source_level == 135
    assert s.usbl.carriers == (15000, 18000)
    assert s.usbl.spacing == 0.033
    assert s.sea.update_interval == 10
    assert s.sea.cell_size == 4
    if name == "paper-extreme":
        assert s.sea.regular_period == 43200
        assert s.sea.regular_amplitude == 5


def test_vortices_of_reference_4():
    current = Scenario.load("paper-extreme").current
    assert current.centres == ((30, 23), (63, 45), (75, 77))
    assert current.circulation_min == current.circulation_max == 8
    assert current.core_radius_min == current.core_radius_max == 48
    assert not current.alternate


def test_toml_round_trip():
    s = Scenario.load("extreme", ["auv.count=5", "current.centres=[[1, 2], [3.5, 4]]", 'name="a \\"b\\""'])
    assert Scenario.from_dict(tomllib.loads(s.to_toml())) == s
    assert Scenario.from_dict(s.to_dict()) == s
    of_a_plugin = s.model_copy(update={"task_parameters": TaskParameters.model_validate({"dwell": 3.5})})
    assert tomllib.loads(of_a_plugin.to_toml())["task_parameters"] == {"dwell": 3.5}


@pytest.mark.parametrize(
    ("override", "parts"),
    [
        ("auv.cout=3", ["auv.cout", "unknown field", "count"]),
        ("auv.count=0", ["auv.count", "0", "greater than or equal to 1"]),
        ("auv.count=17", ["auv.count", "17", "16"]),
        ("auv.count=two", ["auv.count", "two", "integer"]),
        ("task=fishing", ["task", "fishing", "data-collection, station-keeping"]),
        ("task_parameters.radius=3", ["task_parameters.radius", "data-collection", "none"]),
        ("nodes.target_rule=far", ["nodes.target_rule", "far", "greedy[:ALPHA]"]),
        ("auv.action=vektor", ["auv.action", "vektor", "vector", "polar"]),
        ("area.depth=90", ["auv.depth", "area.depth"]),
        ("boat.top_speed=nan", ["boat.top_speed", "nan"]),
        ("auv.speed_max=3.5", ["auv.speed_max = 3.5", "2.5"]),
        ("sea.start_rms=1e6", ["sea.start_rms", "1000000.0", "10"]),
        ("reward.power=1e39", ["reward.power", "1e+39"]),
        ("current.circulation_max=1e5", ["circulation_max = 100000", "core_radius_min = 30", "20 m/s"]),
        ("auv.depth=9", ["auv.depth = 9", "troughs", "14.5 m"]),
        ("usbl.sampling_rate=20000", ["sampling_rate = 20000", "36000 Hz"]),
        ("storm.spectrum=waves", ["storm.spectrum", "jonswap", "tma"]),
        ("storm.shortest_wave=60", ["storm.shortest_wave", "twice the frequency", "storm.peak_period"]),
        ("storm.significant_height=19", ["storm.significant_height", "18.9 m", "break"]),
        ("sea.forced_edge=none", ["forced_edge", "irregular_rms"]),
        ("auv.start_separation=150", ["auv.start_separation", "too large"]),
        ("nodes.margin=100", ["nodes.margin", "100"]),
        ("reference.straight_speed=3", ["reference.straight_speed", "speed_max"]),
        ("reference.zermelo_speed=3", ["reference.zermelo_speed", "speed_max"]),
        ("acoustics.ambient_noise=silence", ["acoustics.ambient_noise", "'silence': allowed are coates"]),
        ("auv", ["--set", "section.field=value"]),
        ("name.x=1", ["--set", "not a section"]),
    ],
)
def test_overrides_that_are_refused(override, parts):
    with pytest.raises(ScenarioError) as error:
        Scenario.load("extreme", [override])
    message = str(error.value)
    assert "\n" not in message
    for part in parts:
        assert part in message


@pytest.mark.parametrize(
    ("overrides", "parts"),
    [
        (["area.depth=30", "auv.depth=20", "sea.regular_amplitude=8"], ["16 m", "half of area.depth, 15 m"]),
        (["mission.step=0.01", "mission.duration=1e6"], ["100000000 steps", "10000000"]),
        (["mission.step=6", "current.count=16"], ["mission.step", "by 56 m", "core_radius_min, 30 m"]),
        (
            ["sea.radiating_edges=[]", 'sea.sponge_edges=["north", "south"]', "sea.sponge_width=101"],
            ["100 m", "overlap"],
        ),
        (["usbl.model=waveform", "usbl.signal=tone", "usbl.periods=10000"], ["usbl.periods", "samples"]),
    ],
)
def test_numbers_that_exclude_one_another(overrides, parts):
    with pytest.raises(ScenarioError) as error:
        Scenario.load("extreme", overrides)
    message = str(error.value)
    assert "\n" not in message
    for part in parts:
        assert part in message


def test_every_number_has_bounds():
    """What a random scenario is drawn from: each number between two finite bounds, its default within them."""
    for name, (_, low, high, default) in numbers().items():
        assert -1e9 < low <= default <= high < 1e9, name


def test_an_override_sets_its_field_alone():
    plain, changed = Scenario.load("extreme"), Scenario.load("extreme", ["sea.regular_amplitude=1"])
    assert changed.sea.regular_amplitude == 1
    assert changed.model_copy(update={"sea": plain.sea}) == plain


def test_unknown_name_lists_the_shipped_ones():
    with pytest.raises(ScenarioError, match="extreme, ideal"):
        Scenario.load("extrem")


def test_damaged_file_is_named(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text("[auv\ncount = 2")
    with pytest.raises(ScenarioError, match=r"bad\.toml: not valid TOML"):
        Scenario.load(path)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ScenarioError, match=r"bad\.toml: cannot be read"):
        Scenario.load(path)


def test_carriers_of_a_larger_team_stay_below_half_a_wavelength_apart():
    s = Scenario.load("extreme", ["auv.count=16"])
    carriers = [s.usbl.carrier(k, 16) for k in range(16)]
    assert carriers[:2] == [15000, 18000]
    assert len(set(carriers)) == 16
    assert all(12000 < f <= 18000 for f in carriers[2:])
    assert all(s.usbl.spacing < 0.5 * s.acoustics.sound_speed / f for f in carriers)
