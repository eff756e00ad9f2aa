"""Files of scenarios that a user writes, and files that are none."""

import tomllib

import pytest


@pytest.mark.parametrize(
    ("command", "told"),
    [
        ("simulate mission.nc", "is a NetCDF file, not a scenario; usvauv replay mission.nc draws a trace"),
        ("eval fixes.csv", "is a CSV file, not a scenario; usvauv plan --log fixes.csv reads a log of fixes"),
        ("sea run", "is a trained policy, not a scenario; usvauv simulate --policy run runs it"),
        ("train study.toml", "is a study, not a scenario; usvauv sweep study.toml runs it"),
        ("sweep mine.toml", "is a scenario, not a study; usvauv simulate mine.toml runs it"),
        ("replay mine.toml", "is a scenario, not a trace; usvauv simulate mine.toml runs it"),
        ("plan --log mission.nc", "is a NetCDF file, not a log of fixes; usvauv replay mission.nc draws a trace"),
        ("plan fixes.csv", "is a CSV file, not a scenario; usvauv plan --log fixes.csv reads a log of fixes"),
        ("mine.toml", "command 'mine.toml': usvauv simulate mine.toml runs it"),
    ],
)
def test_a_file_of_another_kind_is_refused_with_the_command_that_takes_it(tmp_path, refused, command, told):
    (tmp_path / "run").mkdir()
    for name in ("mission.nc", "mission.mp4", "fixes.csv", "run/best.safetensors"):
        (tmp_path / name).touch()
    (tmp_path / "mine.toml").write_text("name = 'mine'\n[auv]\ncount = 3\n")
    (tmp_path / "study.toml").write_text("[[runs]]\nscenario = 'extreme'\n")
    assert told in refused(*command.split())


@pytest.mark.parametrize("command", ["simulate", "eval", "scenarios", "train"])
@pytest.mark.parametrize("content", ["", "# to do\n"])
def test_an_empty_file_is_no_scenario(tmp_path, refused, command, content):
    """As `usvauv scenarios extrem > mine.toml` leaves it."""
    (tmp_path / "mine.toml").write_text(content)
    assert refused(command, "mine.toml").startswith("mine.toml: has no field, so it is no scenario; ")
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]


BAD = """
base = "extreme"
[storm]
significant_height = -2
peak_periodd = 3
[auv]
count = "two"
[sea]
irregular_rms = "calm"
start_rms = 3.0
[current]
core_radius_min = 60
circulation_min = 1000
"""


@pytest.mark.parametrize(
    ("content", "places"),
    [
        (
            BAD,
            [
                "sea.start_rms = 3.0: was removed",
                "sea.irregular_rms = 'calm': input should be a valid number, unable to parse string as a number, or",
                "storm.significant_height = -2: input should be greater than or equal to 0.001",
                "storm.peak_periodd: unknown field; allowed here: spectrum, ",
                "current: circulation_max = 260: must not be below circulation_min, 1000",
                "current: core_radius_max = 25: must not be below core_radius_min, 60",
                "auv.count = 'two': input should be a valid integer",
            ],
        ),
        (
            'base = "extreme"\n[auv]\ndepth = 130\nstart_margin = 100\n[boat]\ncount = 3',
            [
                "auv.depth = 130: must be below area.depth, 120 m",
                "boat.count = 3: must not be above auv.count, 2",
                "auv.start_margin = 100: must be below half the area's smaller side, 100 m",
            ],
        ),
    ],
)
def test_all_that_is_wrong_with_a_scenario_is_said_at_once(tmp_path, run_usvauv, content, places):
    (tmp_path / "bad.toml").write_text(content)
    for command in (["simulate", "bad.toml"], ["scenarios", "bad.toml", "--check"], ["eval", "bad.toml"]):
        code, stdout, stderr = run_usvauv(*command)
        lines = stderr.splitlines()
        assert (code, stdout, len(lines)) == (2, "", len(places))
        for line, place in zip(lines, places, strict=True):
            assert line.startswith(f"error: bad.toml: {place}")


def test_a_changed_copy_of_a_scenario_is_described_by_its_numbers(tmp_path, run_usvauv):
    shipped = run_usvauv("scenarios", "extreme")[1]
    words = tomllib.loads(shipped)["description"]
    assert words.startswith("Storm of WMO sea state 7")
    copy = tmp_path / "mine.toml"
    mission = ("eval", "mine.toml", "--policy", "straight:1.5", "--episodes", 1, "--force")
    for text, own in (
        (shipped, ""),
        (
            shipped.replace("\ncount = 2 ", "\ncount = 3 "),
            "200 × 200 m, 3 AUVs (sparus-ii), 30 nodes, Hs 6.5 m, 1 boat (ocean)",
        ),
        (
            shipped.replace("significant_height = 6.5", "significant_height = 5"),
            "200 × 200 m, 2 AUVs (sparus-ii), 30 nodes, Hs 5 m, 1 boat (ocean)",
        ),
    ):
        copy.write_text(text)
        assert tomllib.loads(run_usvauv("scenarios", "mine.toml")[1])["description"] == (own or words)
        copy.write_text(text.replace("duration = 1000.0", "duration = 5.0"))
        said = " ".join(run_usvauv(*mission)[1].split())
        assert said.startswith(f"extreme, changed: {own}")
    by_itself = ("simulate", "extreme", "--usv", "hold:9,9", "--duration", 3, "--size", "320x240", "--out", "a.webm")
    assert run_usvauv(*by_itself)[1].startswith("extreme, seed 0, ")


def test_a_folder_with_the_name_of_a_scenario_hides_nothing(tmp_path, run_usvauv):
    (tmp_path / "extreme").mkdir()
    (tmp_path / "extreme" / "best.safetensors").touch()
    assert run_usvauv("scenarios", "extreme")[0] == 0
