"""Plugins from files outside the package do what `docs/extending.md` says, which links to those very files."""

import csv
import re
import runpy
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.links import EVERY_STEP
from usvauv import env, policies
from usvauv.env import Scenario, ScenarioError, World, plugins
from usvauv.env.world.observation_layout import ObservationLayout
from usvauv.kernels.mission.columns import AuvColumn, EstimateColumn, NodeColumn
from usvauv.kernels.positioning import usbl
from usvauv.kernels.vehicles.fleet import Fleet
from usvauv.kernels.vehicles.vehicle import Command

ROOT = Path(__file__).parents[1]
OWN_POLICY = ROOT / "examples" / "own_policy.py"
EXAMPLES = [OWN_POLICY, *sorted((ROOT / "examples" / "plugins").glob("*.py"))]
LINE_1 = ", in {}/broken.py, line 1 (set USVAUV_TRACEBACK=1 to see where it comes from)"
SHORT = ("--set", "mission.duration=60", "--episodes", "2")


pytestmark = pytest.mark.usefixtures("own_registries")


@pytest.fixture
def evaluated(run_usvauv, tmp_path):
    """Function: rows of the CSV of `usvauv eval` in a short `ideal` with plugins of the examples and settings."""

    def run(plugins: tuple[str, ...], settings: list[str], *options: str) -> list[dict[str, str]]:
        for plugin in plugins:
            shutil.copy(ROOT / "examples" / "plugins" / plugin, tmp_path)
        given = [*(("--plugin", plugin) for plugin in plugins), *(("--set", setting) for setting in settings)]
        code, _, stderr = run_usvauv(
            "eval", "ideal", *SHORT, *options, *(part for pair in given for part in pair), "--force"
        )
        assert code == 0, stderr
        with (tmp_path / "metrics.csv").open() as stream:
            return list(csv.DictReader(stream))

    return run


def test_the_page_links_to_each_file_and_shows_them_as_they_are():
    text = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
    sources = [path.read_text(encoding="utf-8") for path in EXAMPLES]
    assert all(f"](../{path.relative_to(ROOT).as_posix()})" in text for path in EXAMPLES)
    assert [shown for shown in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if shown not in sources] == []


def test_task_and_vehicle(evaluated):
    """Two plugins in one mission: the vehicle pays for the speed of `straight` by its own law."""

    def survey(*settings: str) -> list[dict[str, str]]:
        return evaluated(("task.py", "vehicle.py"), [*vehicle, "task=survey", *settings], "--policy=straight:1.6")

    vehicle = [
        "auv.count=3",
        "auv.model=dubins",
        "nodes.service=passing",
        "vehicle_parameters.drag=5",
        "auv.speed_min=1.2",
    ]
    wide = "task_parameters.radius=80"
    near, far, weighted = survey(), survey(wide), survey(wide, "task_parameters.visit=30")
    visits = [sum(float(row["visits"]) for row in rows) for rows in (near, far)]
    assert visits[1] > 2 * visits[0] > 0
    for row, other in zip(far, weighted, strict=True):
        gained = 20 * float(row["visits"]) / 60
        assert float(other["arps"]) - float(row["arps"]) == pytest.approx(gained, rel=1e-5)
    for row in near:
        assert float(row["ec"]) == pytest.approx(15.0 + 5.0 * 1.6**3, rel=0.02)
    for wrong, why in (("radius=0.5", "radius = 0.5: must be from 1 to 1000"), ("span=1", "span: allowed .*: radius,")):
        with pytest.raises(ScenarioError, match=f"^ideal: vehicle_parameters.{why}"):
            Scenario.load("ideal", [*vehicle, f"vehicle_parameters.{wrong}"])


def test_a_vehicle_turns_on_its_own_radius():
    plugins.load(ROOT / "examples" / "plugins" / "vehicle.py")
    auvs = Fleet(3, "dubins", {"radius": 12.0})
    auvs.set(Command, speed=1.5, depth=20.0)
    auvs.trim()
    auvs.set(Command, heading=[2.0, -2.0, 0.0])
    auvs.flight(1, commanded=True)()
    assert auvs.numpy("r") == pytest.approx([1.5 / 12.0, -1.5 / 12.0, 0.0])


def test_boat_strategy_target_rule_noise_law_observation_term_and_policy(evaluated, run_usvauv, tmp_path, monkeypatch):
    """Four plugins and a policy by MODULE:CLASS in one mission; each does what its page says."""
    shutil.copy(OWN_POLICY, tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])  # which gets the working directory
    monkeypatch.delitem(sys.modules, "own_policy", raising=False)  # of another test
    files = ("boat_strategy.py", "target_rule.py", "noise_law.py", "observation_term.py")
    changes = [*EVERY_STEP, "acoustics.ambient_noise=wind-only", 'observation.extra=["backlog"]']
    options = ["--policy=own_policy:Nearing", "--policy=straight", "--usv=above:0", "--usv=above:1", "--targets=oldest"]
    quiet, loud = (evaluated(files, [*changes, f"acoustics.wind={wind}"], *options) for wind in (1, 4))
    assert {row["targets"] for row in quiet} == {"oldest"}
    own, straight = ([row for row in quiet if row["policy"] == policy] for policy in ("own_policy:Nearing", "straight"))
    for rows in (own, straight):
        assert [row["usv"] for row in rows] == ["above:0", "above:0", "above:1", "above:1"]
        assert len({row["position_error_mean"] for row in rows}) == len(rows)
    for a, b in zip(straight, (row for row in loud if row["policy"] == "straight"), strict=True):
        # Two doublings of the wind are 10 dB, which amplitudes of noise have as a factor √10.
        assert float(b["fix_error_median"]) == pytest.approx(10**0.5 * float(a["fix_error_median"]), rel=0.1)
    code, _, stderr = run_usvauv("eval", "--usv", "above:2", "--plugin", "boat_strategy.py", "--force")
    assert (code, stderr.strip()) == (2, "error: usv: 'above:2': the AUV must be from 0 to 1")

    example = runpy.run_path(str(OWN_POLICY))
    scenario = Scenario.load("ideal", [*changes, "acoustics.wind=1", "mission.duration=60"])
    compared = {"own_policy:Nearing": example["Nearing"]}
    found = env.run_episodes(scenario, compared, episodes=2, usv="above:0", targets="oldest")
    assert own[:2] == [{name: str(value) for name, value in row.columns().items()} for row in found]

    world = World(Scenario.load("ideal", [*changes, "nodes.count=6"]), 8, usv="above:0", targets="oldest")
    assert world.observation_size == ObservationLayout.of(Scenario.load("ideal")).size + 1
    act, observation = policies.acting("straight", world), world.reset()
    backlog = world.node[..., NodeColumn.backlog].gather(1, world.auv[..., AuvColumn.target].long())
    (index,) = range(*world.observation_layout.slice("backlog").indices(world.observation_size))
    assert (observation[..., index] - backlog / 5000).abs().max() < 1e-6
    assert backlog.min() > 0
    # No AUV takes a node while a free one was visited longer ago.
    visited, before, seen = np.full((8, 6), -1), world.auv[..., AuvColumn.target].int().tolist(), 0
    served = np.zeros((8, 2), bool)
    for step in range(200):
        observation = world.step(act(observation))[0]
        targets = world.auv[..., AuvColumn.target].int().tolist()
        hovers = world.auv[..., AuvColumn.hovering].cpu().numpy() > 0
        for w, k in zip(*np.nonzero(hovers & ~served), strict=True):
            visited[w, before[w][k]] = step
        served = hovers
        for w, (old, new) in enumerate(zip(before, targets, strict=True)):
            changed = [k for k in range(2) if old[k] != new[k]]
            if len(changed) == 1:
                free = [i for i in range(6) if i not in (*old, new[1 - changed[0]])]
                assert visited[w, new[changed[0]]] == visited[w, free].min()
                seen += 1
        before = targets
    assert seen > 30


def test_schedule():
    """The first interrogation, which lasts longer than a step, is of the AUV that the plugin says, and is answered."""
    plugins.load(ROOT / "examples" / "plugins" / "schedule.py")
    changes = ["auv.count=4", "channel.schedule=variance", "channel.turn_around=1.2"]
    world = World(Scenario.load("ideal", changes), 50)
    world.reset()
    variance = 1 + torch.rand(50, 4, generator=torch.Generator().manual_seed(1))
    for axis in ("covariance_xx", "covariance_yy"):
        world.estimate[..., getattr(EstimateColumn, axis)] = variance.to(world.device)
    for _ in range(2):
        world.step(torch.zeros(50, 4, 2, device=world.device))
    heard = world.auv[..., AuvColumn.fix_flags].int().cpu() & usbl.DETECTED > 0
    assert torch.equal(heard, variance == variance.amax(1, keepdim=True))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("import nowhere", f"plugin broken.py: ModuleNotFoundError: No module named 'nowhere'{LINE_1}"),
        ("raise type('Odd', (BaseException,), {})('no')", f"plugin broken.py: Odd: no{LINE_1}"),
        ("raise SystemExit", f"plugin broken.py: SystemExit{LINE_1}"),
        (
            "from usvauv.extend.task import target_rules\ntarget_rules.register('greedy', None)",
            "plugin broken.py: target rule 'greedy': is registered already",
        ),
        (
            "from usvauv.extend import HEURISTICS",
            "plugin broken.py: ImportError: usvauv.extend.HEURISTICS is usvauv.extend.policy.heuristics since 0.4"
            f"{LINE_1}",
        ),
    ],
)
def test_a_plugin_that_cannot_be_loaded_gives_one_line(run_usvauv, tmp_path, text, message):
    (tmp_path / "broken.py").write_text(text)
    code, _, stderr = run_usvauv("eval", "--plugin", "broken.py")
    assert (code, stderr.strip()) == (2, f"error: {message.format(tmp_path.resolve())}")
    assert not (tmp_path / "metrics.csv").exists()
