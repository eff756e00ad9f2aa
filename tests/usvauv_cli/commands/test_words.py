"""What commands list, what they say about a value that is not known."""

import re

import pytest

from usvauv.cli import terminal
from usvauv.env import Scenario
from usvauv.kernels.mission.boats.boat_strategies import boat_strategies
from usvauv.kernels.mission.target_rules import target_rules
from usvauv.policies import trained
from usvauv.policies.heuristics import heuristics

PLUGIN = '''
import taichi as ti
from usvauv.extend.boat import BoatStrategy, Strategy, boat_strategies
from usvauv.extend.policy import heuristics, Heuristic
from usvauv.extend.task import TargetRule, target_rules
from usvauv.extend.world import vec2

@ti.func
def north(worlds: ti.template(), w, b) -> vec2:
    """Goes to the northern edge. Nobody knows why."""
    return vec2(0.0, 200.0)

class Lazy(Heuristic):
    """Stays where
    it is."""

    parameter = ("PATIENCE", "s")

    def act(self, observation):
        return observation[..., :2]

boat_strategies.register("north", BoatStrategy(Strategy(start=north, goal=north), ("AUV",)))
heuristics.register("lazy", Lazy)
target_rules.register("last", TargetRule(north, arguments=(("AGE", 3.0),), units=("s",), about="The last node"))
'''


def listed(text: str) -> dict[str, str]:
    """Name → the rest of its paragraph, of a list in the terminal."""
    found, name = {}, ""
    for line in text.splitlines():
        if line.startswith("   "):
            found[name] += f" {line.strip()}"
        elif line.startswith("  "):
            name, _, about = line.strip().partition(" ")
            found[name] = about.strip()
    return found


class TestLists:
    @pytest.mark.parametrize(
        ("command", "names", "parts"),
        [
            (
                "policies",
                [*heuristics, *trained()],
                {"keep": "Default in station-keeping", "circle[:RADIUS]": "reference.circle_radius."},
            ),
            (
                "boats",
                boat_strategies,
                {"hold:X,Y": "X, Y in m.", "belief": "Default in tracking, wide, wide-torpedo.", "agent": "World.step"},
            ),
            ("targets", target_rules, {"rollout[:HORIZON]": "HORIZON in s, default 90. Default in survey."}),
            ("scenarios", Scenario.shipped(), {"wide": "600 m × 600 m, 8 AUVs, 1 boat, 16 min 40 s."}),
        ],
    )
    def test_have_all_that_there_is_each_in_a_sentence(self, run_usvauv, command, names, parts):
        code, text, errors = run_usvauv(command)
        assert (code, errors) == (0, "")
        assert max(map(len, text.splitlines())) <= 80
        rows = listed(text)
        assert {name.partition(":")[0].partition("[")[0] for name in rows} - {"PATH", "MODULE"} == set(names)
        assert all(len(about.split()) > 3 and about.endswith(".") for about in rows.values())
        assert not any(re.search(r"\b[bkw]\b", about) for about in rows.values())  # a name in a kernel is no word
        for name, part in parts.items():
            assert part in rows[name]

    def test_which_policy_is_learned_and_in_what(self, run_usvauv):
        learned = run_usvauv("policies")[1].partition("Learned, shipped with usvauv:\n")[2].partition("Your own:")[0]
        assert list(listed(learned)) == trained()
        assert listed(learned)["sac-extreme"] == "SAC, trained in extreme with 2 AUVs and the boat fim."

    def test_have_what_a_plugin_adds(self, tmp_path, run_usvauv, own_registries):
        (tmp_path / "mine.py").write_text(PLUGIN)
        for command, name, about in (
            ("policies", "lazy[:PATIENCE]", "Stays where it is. PATIENCE in s."),
            ("boats", "north:AUV", "Goes to the northern edge."),
            ("targets", "last[:AGE]", "The last node. AGE in s, default 3."),
        ):
            text = run_usvauv(command, "--plugin", "mine.py")[1]
            assert listed(text.partition("Of the plugin mine.py:\n")[2])[name] == about


def test_no_line_ends_between_a_number_and_its_unit():
    first, second = terminal.wrapped("goes " * 15 + "7 m/s, then stops", 2).splitlines()
    assert (first, second) == ("goes " * 14 + "goes", "  7 m/s, then stops")


@pytest.mark.parametrize(
    ("arguments", "guess"),
    [
        ("simulate extrem", "extreme"),
        ("simulate --compare usv=feem", "fim"),
        ("simulate --view se", "sea"),
        ("simulate --set target_rule=tour", "nodes.target_rule"),
        ("simulate --set sea.forced_edge=souht", "south"),
        ("train --learn hiden=8", "hidden"),
        ("export x.nc --to mcpa", "mcap"),
    ],
)
def test_a_name_that_is_mistyped_is_guessed(refused, arguments, guess):
    error = refused(*arguments.split())
    assert error.endswith(f"; did you mean {guess!r}?\n")
    assert "allowed" in error


def test_what_can_be_reproduced_is_listed_with_its_time(tmp_path, run_usvauv):
    code, text, errors = run_usvauv("reproduce")
    assert (code, errors) == (0, "")
    rows = listed(text)
    assert list(rows) == ["table2", "fig3", "fig4a", "fig4b", "all", "collaboration"]
    assert all(re.search(r"; about \d+ min on two cores, \d+ min with --quick\.$", about) for about in rows.values())
    assert run_usvauv("reproduce", "fig3")[::2] == (2, "error: --out: needed, the folder of the results\n")
    assert not list(tmp_path.iterdir())
