"""Scenarios: what ships, what is refused and how."""

import json
import math
import re
import tomllib
from importlib import resources

import pytest

from tests.trials.scenarios import numbers
from usvauv.env import Scenario, ScenarioError
from usvauv.env.scenario.fields import CLASSES, Section, classes_of
from usvauv.env.scenario.team import PluginNumbers


@pytest.mark.parametrize("name", Scenario.shipped())
def test_file_holds_what_differs_and_what_is_printed_explains_every_field(name):
    text = (resources.files("usvauv.env") / "scenarios" / f"{name}.toml").read_text(encoding="utf-8")
    given, whole = tomllib.loads(text), Scenario.load(name).to_toml()
    base = (Scenario.load(given["base"]) if "base" in given else Scenario()).to_dict()
    for section, fields in given.items():
        for field in fields if isinstance(fields, dict) else ():
            assert Scenario.load(name).to_dict()[section][field] != base[section].get(field), f"{section}.{field}"
    assert tomllib.loads(whole) == Scenario.load(name).to_dict()
    assert Scenario.load(name).name == name
    fields = [line for line in whole.splitlines() if line and not line.startswith("[")]
    assert len(fields) > 150
    assert all("  # " in line and line.split("  # ")[1].strip() for line in fields)


def test_what_a_file_leaves_out_is_as_in_a_calm_scenario():
    """Each default is that of `ideal` or of `paper-ideal`: no wave, current or error comes unasked."""
    ideal = Scenario.load("ideal", ["boat.vessel=none", "boat.response_time=3", "auv.vehicle=none"])
    plain, *calm = Scenario(), ideal, Scenario.load("paper-ideal")
    for name, section in plain:
        for field, value in section if isinstance(section, Section) else ():
            assert value in [getattr(getattr(each, name), field) for each in calm], f"{name}.{field}"


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
        assert s.current.centres == ((30, 23), (63, 45), (75, 77))  # of its reference [4], as the next two
        assert s.current.circulation_min == s.current.circulation_max == 8
        assert s.current.core_radius_min == s.current.core_radius_max == 48


@pytest.mark.parametrize(("section", "name"), [(section, name) for section in CLASSES for name in classes_of(section)])
def test_numbers_of_a_class_lie_under_those_of_a_scenario(tmp_path, section, name):
    (tmp_path / "mine.toml").write_text(f'[{section}]\n{CLASSES[section]} = "{name}"\ncount = 1\n')
    plain, data = Scenario.load(tmp_path / "mine.toml"), classes_of(section)[name]
    for part, values in data.items():
        assert plain.to_dict()[part].items() >= values.items()
    assert Scenario.from_dict(plain.to_dict()) == plain
    field, value = next((field, value) for field, value in data[section].items() if isinstance(value, float))
    own = Scenario.load(tmp_path / "mine.toml", [f"{section}.{field}={0.99 * value!r}"])
    assert own.to_dict()[section] == plain.to_dict()[section] | {field: 0.99 * value}


def test_a_class_that_there_is_not_is_refused():
    with pytest.raises(ScenarioError, match=r"^ideal: boat.vessel: 'remus-100': allowed are none, .*otter"):
        Scenario.load("ideal", ["boat.vessel=remus-100"])


def test_toml_round_trip():
    s = Scenario.load("extreme", ["auv.count=5", "current.centres=[[1, 2], [3.5, 4]]", 'name="a \\"b\\""'])
    assert Scenario.from_dict(tomllib.loads(s.to_toml())) == s
    assert Scenario.from_dict(s.to_dict()) == s
    of_a_plugin = s.model_copy(update={"task_parameters": PluginNumbers.model_validate({"dwell": 3.5})})
    assert tomllib.loads(of_a_plugin.to_toml())["task_parameters"] == {"dwell": 3.5}


def test_every_number_has_bounds():
    """What a random scenario is drawn from: each number between two finite bounds, its default within them."""
    for name, (_, low, high, default) in numbers().items():
        assert -1e9 < low <= default <= high < 1e9, name


@pytest.mark.parametrize(
    ("retired", "version"),
    [
        ("planner.horizon=12", "0.3"),
        ("planner.objective=e", "0.3"),
        ("channel.schedule=by-need", "0.4"),
        ("channel.schedule=round-robin", "0.4: its name is turns"),
        ("channel.data_ratio=18", "0.4: channel.bit_rate decides"),
        ("reference.zermelo_speed=2", "0.4: with"),
        ("usbl.model=waveform", "0.4: fixes are drawn"),
        ("acoustics.sediment=gravel", "0.4: fixes are drawn"),
        ("auv.action=polar", "0.4: an action is a velocity"),
        ("usbl.latency=2", "0.4"),
    ],
)
def test_what_is_gone_is_refused_in_a_file_and_read_from_what_was_stored(tmp_path, retired, version):
    name, _, value = retired.partition("=")
    section, _, field = name.partition(".")
    (tmp_path / "old.toml").write_text(f"[{section}]\n{field} = {value if value.isdigit() else repr(value)}\n")
    for source, overrides in ((tmp_path / "old.toml", []), ("extreme", [retired])):
        with pytest.raises(ScenarioError, match=rf"^{source}: {name} = '?{value}'?: was removed in {version}"):
            Scenario.load(source, overrides)
    content = Scenario.load("extreme", ["planner.measurement=phase", "channel.schedule=turns"]).to_dict()
    stored = Scenario.from_dict({**content, section: {**content[section], field: value}}, stored=True)
    assert stored.to_dict() == content


def test_a_file_that_an_earlier_version_printed_is_read(tmp_path):
    (tmp_path / "printed.toml").write_text(
        '[planner]\nhorizon = 10\n[auv]\nrefused_power = "hovering"\n[reference]\nzermelo_speed = 1.7\n'
        "[sea]\nsponge_edges = []\nsponge_width = 40.0\n"
        "[tracker]\nenabled = false\ncurrent_reading = 0.0\n"
        '[usbl]\nmodel = "statistical"\nlatency = 0.0\n[acoustics]\nmultipath = false\nsediment = "sand"\n'
    )
    assert Scenario.load(tmp_path / "printed.toml") == Scenario.from_dict({})


def test_unknown_name_lists_the_shipped_ones():
    with pytest.raises(ScenarioError, match="extreme, extreme-torpedo, ideal"):
        Scenario.load("extrem")


def test_carriers_of_a_larger_team_stay_below_half_a_wavelength_apart():
    s = Scenario.load("extreme", ["auv.count=16"])
    carriers = [s.usbl.carrier(k, 16) for k in range(16)]
    assert carriers[:2] == [15000, 18000]
    assert len(set(carriers)) == 16
    assert all(12000 < f <= 18000 for f in carriers[2:])
    assert all(s.usbl.spacing < 0.5 * s.acoustics.sound_speed / f for f in carriers)


PEAK = 0.6382 / (2 * math.pi)  # of a Lamb–Oseen vortex, over Γ/δ
DRAWN = math.sqrt(2) / (4 * PEAK)  # Γ of three vortices that in two seconds carry one another 1 m
NO_LENGTH = "boat.vessel=none boat.dead_band=0"  # so that storm.shortest_wave counts
SEA = f"{NO_LENGTH} sea.gravity=10 storm.spectrum=pm storm.peak_period=10 storm.significant_height=1"
TIDE = "sea.forced_edge=east sea.regular_amplitude="
SHALLOW = f"{SEA} area.depth=5 auv.depth=4"
LONG = "sea.forced_edge=east area.depth=50 auv.depth=45 sea.regular_amplitude=5"
SWELL = f"{TIDE}4 storm.spectrum=pm storm.significant_height=3 storm.swells=[[4,9,1,0,1]]"
MUTUAL = "current.mutual=true current.count=3 current.core_radius_min=1 mission.step=2"


@pytest.mark.parametrize(
    ("given", "field", "allowed", "refused", "said"),
    [
        ("", "auv.depth", 119.9, 120, "must be below area.depth, 120 m"),
        ("auv.depth=120", "auv.separation", "demonstration", "geometry", "must be below area.depth, 120 m"),
        ("auv.count=3", "boat.count", 3, 4, "must not be above auv.count, 3"),
        ("area.length=100", "nodes.margin", 49.9, 50, "nodes.margin = 50: must be below half .* side, 50 m"),
        ("area.width=100 auv.start_separation=0", "auv.start_margin", 49.9, 50, "auv.start_margin = 50: .* side, 50 m"),
        (
            "auv.count=4 auv.start_margin=18 area.width=236 area.length=136",
            "auv.start_separation",
            50,
            50.1,
            "most 50 m",
        ),
        ("", "reference.crab_speed", 0.05, 0.049, "0.05 to 2 m/s"),
        ("mission.step=5", "nodes.arrival_rates", [1, 16, 2], [1, 17, 2], "up to 17: must not be above 16 at mission"),
        ("mission.step=0.01", "mission.duration", 1e5, 100000.01, "10000001 steps: must be at most 10000000"),
        ("task=station-keeping area.length=100", "stations.radius", 50, 50.1, "half the area's smaller side, 50 m"),
        (LONG, "sea.irregular_rms", 5, 5.1, "= 25.4 m: must not be above half of area.depth, 25 m"),
        (f"{TIDE}16 area.depth=20 auv.depth=19", "water.bathymetry", "a.nc", "", "half of area.depth, 10 m"),
        (f"{SEA} {TIDE}20", "auv.depth", 21.1, 21, "must be below the troughs of the waves, 21 m"),
        (f"{TIDE}20 auv.depth=20", "auv.separation", "demonstration", "geometry", "troughs of the waves, 20 m"),
        (SWELL, "auv.depth", 9.1, 9, "must be below the troughs of the waves, 9 m"),
        (SHALLOW, "storm.significant_height", 3, 3.1, "not be above 3 m, where such waves break"),
        (SEA, "storm.significant_height", 15.9, 16, "storm.significant_height = 16: must not be above 15.9 m"),
        (SEA, "storm.swells", [[15.9, 10, 1, 0, 1]], [[16, 10, 1, 0, 1]], "not be above 15.9 m"),
        ("storm.spectrum=pm storm.significant_height=20", "water.waves", "a.nc", "", "not be above 18.9 m"),
        ("storm.spectrum=pm storm.significant_height=9 auv.depth=9", "water.waves", "a.nc", "", "troughs of the waves"),
        (SEA, "storm.shortest_wave", 39.7, 39.8, "twice the frequency"),  # 10 m/s² (10 s)²/8π = 39.79 m
        (f"{SHALLOW} storm.shortest_wave=31.416", "storm.peak_period", 10.19, 10.17, "twice the frequency"),  # tanh 1
        (MUTUAL, "current.circulation_max", 0.999 * DRAWN, 1.001 * DRAWN, "by 1 m in a step; at most .* 1 m"),
        (
            "current.count=20",
            "current.circulation_max",
            1199.9 / 16 / PEAK,
            1200.1 / 16 / PEAK,
            "up to 40 m/s; allowed",
        ),
        ("usbl.carriers=[9000] usbl.carrier_max=20000", "usbl.sampling_rate", 40000, 39999, "two a period, 40000 Hz"),
        ("", "auv.speed_min", 2, 2.01, "speed_max = 2: must not be below speed_min, 2.01"),
        ("", "nodes.buffer", 1000, 999, "start_backlog = 1000: must not be above buffer, 999"),
        ("", "sea.manning", 0, 0.01, 'needs equations = "nonlinear"'),
        ("sea.manning=0.01", "sea.equations", "nonlinear", "linear", 'needs equations = "nonlinear"'),
        ("", "sea.regular_amplitude", 0, 0.1, "forced_edge must name an edge"),
        ("sea.forced_edge=west", "sea.radiating_edges", ["east"], ["west"], "not name an edge twice: west"),
        ("channel.bit_rate=0", "channel.schedule", "turns", "every-step", "needs a channel.schedule other"),
        ("channel.schedule=all", "channel.bit_rate", 8000, 8001, "from 1 bit/s to 2 times acoustics.bandwidth, 8000"),
        (
            "channel.bit_rate=1000",
            "acoustics.path",
            "transponder",
            "echo",
            "'echo': must be 'transponder' with channel",
        ),
    ],
)
def test_the_limit_itself_is_allowed(given, field, allowed, refused, said):
    """Or the last number before it; the first beyond is refused with the limit, here worked out on paper."""

    def load(value):
        return Scenario.load("ideal", [*given.split(), f"{field}={json.dumps(value)}"])

    load(allowed)
    with pytest.raises(ScenarioError, match=said):
        load(refused)


@pytest.mark.parametrize(
    "name", ["../../x", "/abs/x", "a\0b", "a\nb", "..", ".x", "a\\b", "-x", " x", "", 121 * "x", 41 * "海", "\u202e"]
)
def test_a_name_that_would_name_other_files_is_refused(name):
    with pytest.raises(ScenarioError, match=r"^mine: name\b.*: ") as refused:
        Scenario.from_dict({"name": name}, "mine")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("name", ["Bob's $5 <b>", "a: b, 50 %", 40 * "海", "بحر", 120 * "x", "c..d"])
def test_any_other_name_is_one(name):
    assert Scenario.from_dict({"name": name}).name == name


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("auv.x=1", "^ideal: auv.x: unknown field; allowed here: count, model, vehicle, variation"),
        ("auv.count=two", "^ideal: auv.count = 'two': input should be a valid integer"),
        ("current.centres=[[true,2]]", r"^ideal: current.centres = \[\[True, 2\]\]: must not be true or false$"),
        ("nodes.arrival_rates=1", "^ideal: nodes.arrival_rates = 1: must be a list$"),
        ("boat=1", "^ideal: boat = 1: must be a section with fields$"),
        ("task=fishing", "^ideal: task: 'fishing': allowed are data-collection, station-keeping"),
        ("task_parameters.radius=3", "^ideal: task_parameters.radius: allowed for task 'data-collection': none"),
        ("nodes.target_rule=far", r"^ideal: nodes.target_rule: .*far.*greedy\[:ALPHA\]"),
        (
            "auv.action=vektor",
            "^ideal: auv.action = 'vektor': allowed are vector, vector-depth, fins; did you mean 'vector'",
        ),
        ("boat.top_speed=nan", "^ideal: boat.top_speed = nan: "),
        ("sea.drag=1e6", "^ideal: sea.drag = 1000000.0: input should be less than or equal to 1"),
        ("acoustics.ambient_noise=silence", "^ideal: acoustics.ambient_noise: 'silence': allowed are coates"),
        ("auv.count", "^--set 'auv.count': expected section.field=value"),
        ("name.first=1", "^ideal: name = {'first': 1}: input should be a valid string$"),
        (f"{'a.' * 32}a=1", r"^--set 'a\..*=1': nested too deep$"),
    ],
)
def test_one_line_names_file_field_and_value(override, said):
    with pytest.raises(ScenarioError, match=said):
        Scenario.load("ideal", [override])


class TestBase:
    """Files that state what differs from another scenario."""

    @pytest.fixture
    def write(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        (tmp_path / "mine").mkdir()

        def write(**files):
            for name, text in files.items():
                (tmp_path / "mine" / f"{name}.toml").write_text(text)

        return write

    def test_tables_are_merged_and_lists_replaced(self, write):
        write(
            far='base = "extreme"\n[auv]\ncount = 4\n[nodes]\narrival_rates = [1.0, 2.0]\n',
            own='base = "far.toml"\nname = "own"\n[auv]\ndepth = 90.0\n[nodes]\narrival_rates = [3.0]\n',
        )
        changes = ["auv.count=4", "auv.depth=90", "nodes.arrival_rates=[3.0]", "name=own"]
        assert Scenario.load("mine/own.toml") == Scenario.load("extreme", changes)
        assert Scenario.load("mine/own.toml", ["auv.count=3"], auv={"count": 2}).auv.count == 3

    @pytest.mark.parametrize(
        ("own", "far", "said"),
        [
            ('"none.toml"', "", "mine/own.toml: base = 'mine/none.toml': there is no such file"),
            ('"own.toml"', "", "mine/own.toml → mine/own.toml: base: a scenario cannot be based on itself"),
            (
                '"far.toml"',
                'base = "../mine/own.toml"',
                "mine/own.toml → mine/far.toml → mine/../mine/own.toml: base: a scenario cannot be based on itself",
            ),
            ('"far.toml"', "x", "mine/own.toml → mine/far.toml: not valid TOML: "),
            ("3", "", "mine/own.toml: base = 3: must be a shipped name or the path of a TOML file"),
            ('"far.toml"', "[auv]\ncount = 0", "mine/far.toml: auv.count = 0: "),
            ('"far.toml"', "[auv]\ndepth = 200.0", "mine/far.toml: auv.depth = 200: must be below area.depth"),
            ('"far.toml"', "[planner]\nhorizon = 12", "mine/far.toml: planner.horizon = 12: "),
        ],
    )
    def test_the_file_with_the_problem_is_named(self, write, own, far, said):
        write(own=f"base = {own}\n[auv]\nspeed_max = 2.0\n", far=far)
        with pytest.raises(ScenarioError, match=f"^{re.escape(said)}"):
            Scenario.load("mine/own.toml")

    @pytest.mark.parametrize(
        ("changes", "said"),
        [
            ({"auv": {"count": 0}}, "Scenario.load(…, auv=…): count = 0: input should be greater"),
            ({"auv": {"cuont": 3}}, "Scenario.load(…, auv=…): cuont: unknown field; allowed here: count, "),
            (
                {"area": {"width": 60.0, "length": 60.0}, "auv": {"count": 6}},
                "Scenario.load(…, auv=…): start_separation = 20: is too large for 6 AUVs in this area",
            ),
            ({"auv": 3}, "Scenario.load(…, auv=…): auv = 3: must be a section with fields"),
            ({"task": "fishing", "auv": {"count": 3}}, "Scenario.load(…, task=…): task: 'fishing': allowed are "),
            ({"base": "wide"}, "Scenario.load(…, base=…): base: unknown field"),
        ],
    )
    def test_keywords_are_named_as_python_has_them(self, changes, said):
        with pytest.raises(ScenarioError, match=f"^{re.escape(said)}"):
            Scenario.load("extreme", **changes)
