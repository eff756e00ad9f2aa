"""Policies as ONNX: the same actions in onnxruntime, a file that explains itself, refusals."""

from __future__ import annotations

import json
from pathlib import Path

import onnxruntime
import pytest
import torch

from tests.slowly import slowly
from usvauv import policies
from usvauv.env import Scenario
from usvauv.env.site.site import Site
from usvauv.env.world.agents import observed
from usvauv.policies import LearnedPolicy, PolicyError, TrainingConfig
from usvauv.policies import export as exporting
from usvauv.policies.algorithms import algorithms
from usvauv.policies.export import export
from usvauv.policies.frames import frames
from usvauv.policies.learned import Standardizer

KINDS = {
    "shared": (["auv.count=3", "observation.current=speed"], {"shared": True}),
    "deterministic": (["observation.current=none"], {"algorithm": "td3"}),
    "alone": (["auv.count=1"], {"algorithm": "ddpg", "frame": "world"}),
}


def observations(scenario: Scenario, worlds: int) -> torch.Tensor:
    """Anywhere in their ranges, more than missions fill."""
    low, high = torch.tensor([(number.low, number.high) for number in observed(Site(scenario))]).T
    draw = torch.rand((worlds, scenario.auv.count, len(low)), generator=torch.Generator().manual_seed(3))
    return low + (high - low) * draw


def untrained(scenario: Scenario, **settings) -> LearnedPolicy:
    """A policy with random weights, large enough for its actions to differ from one observation to the next."""
    config = TrainingConfig(**settings)
    frame = frames[config.frame](scenario)
    sizes = frame.sizes(config.shared)
    actor = algorithms[config.algorithm].make_actor(sizes, config, torch.Generator().manual_seed(1))
    actor.requires_grad_(False).weights[-1].mul_(300.0)
    standardizer = Standardizer.of(frame.encode(observations(scenario, 20)))
    return LearnedPolicy("untrained", scenario, config.frame, standardizer, actor, config.shared)


@pytest.fixture(scope="module", params=slowly(KINDS, "deterministic", "alone"))
def exported(request, tmp_path_factory):
    """A policy, the session that runs its file, and the file."""
    overrides, settings = KINDS[request.param]
    policy = untrained(Scenario.load("extreme", overrides), **settings)
    path = tmp_path_factory.mktemp(request.param) / "policy.onnx"
    export(policy, path)
    return policy, onnxruntime.InferenceSession(path), path


def check_actions(policy: LearnedPolicy, session: onnxruntime.InferenceSession) -> None:
    observation = observations(policy.scenario, 64)
    for worlds in (1, 2, 3, 64):
        some = observation[:worlds]
        (action,) = session.run(["action"], {"observation": some.numpy()})
        expected = policy.act(some).detach()
        torch.testing.assert_close(torch.from_numpy(action), expected, atol=1e-5, rtol=0)
    assert expected.std() > 0.1


def check_metadata(policy: LearnedPolicy, session: onnxruntime.InferenceSession, path: Path) -> None:
    assert b".py" not in path.read_bytes()  # nothing of this machine
    read = {name: json.loads(text) for name, text in session.get_modelmeta().custom_metadata_map.items()}
    assert set(read) == {"observation", "action", "policy"}
    (given,), (taken,) = session.get_outputs(), session.get_inputs()
    assert taken.shape == ["N", policy.scenario.auv.count, len(read["observation"])]
    assert given.shape == ["N", policy.scenario.auv.count, len(read["action"])]
    for rows in (read["observation"], read["action"]):
        assert [row["index"] for row in rows] == list(range(len(rows)))
        assert all(set(row) == {"index", "quantity", "unit", "low", "high"} for row in rows)
        assert all(row["quantity"] and row["unit"] and row["low"] < row["high"] for row in rows)
        assert len({row["quantity"] for row in rows}) == len(rows)
    assert read["policy"]["scenario"] == "extreme"
    assert read["policy"]["num_auvs"] == policy.scenario.auv.count
    if policy.name == "sac-extreme":
        assert read["policy"]["command"].startswith("usvauv train extreme")
        assert len(read["policy"]["commit"]) >= 40
    assert policy.name in session.get_modelmeta().description


def test_actions_are_those_of_torch(exported):
    check_actions(*exported[:2])


def test_metadata_are_complete(exported):
    check_metadata(*exported)


class TestCommand:
    @pytest.mark.slow
    def test_it_writes_a_shipped_policy_and_nothing_else(self, tmp_path, run_usvauv):
        code, out, err = run_usvauv("export", "sac-extreme", "extreme", "--set", "auv.speed_max=2.2")
        assert (code, err) == (0, "")
        assert "sac-extreme.onnx: observation (N, 2, 23), action (N, 2, 2)" in out
        assert [path.name for path in tmp_path.iterdir()] == ["sac-extreme.onnx"]
        session = onnxruntime.InferenceSession("sac-extreme.onnx")
        assert '"unit": "2.2 m/s"' in session.get_modelmeta().custom_metadata_map["action"]
        faster = policies.load_learned("sac-extreme").for_scenario(Scenario.load("extreme", ["auv.speed_max=2.2"]))
        check_actions(faster, session)
        check_metadata(faster, session, tmp_path / "sac-extreme.onnx")

    @pytest.mark.parametrize(
        ("arguments", "parts"),
        [
            (["straight"], ["policy straight", "only learned policies"]),
            (["sac-extreme", "paper-ideal"], ["observed current profile", "has speed"]),
            (["sac-extreme", "--set", "auv.count=3"], ["--set", "name the scenario"]),
        ],
    )
    def test_bad_input_is_one_line_and_exit_code_2(self, tmp_path, run_usvauv, arguments, parts):
        code, _, err = run_usvauv("export", *arguments)
        assert code == 2
        assert err.startswith("error: ")
        assert err.count("\n") == 1
        assert all(part in err for part in parts)
        assert not list(tmp_path.iterdir())

    def test_without_the_extra(self, tmp_path, monkeypatch):
        monkeypatch.setattr(exporting, "find_spec", lambda name: None if name == "onnxscript" else name)
        with pytest.raises(PolicyError, match=r'needs onnxscript: pip install .*\[onnx\]"'):
            export(policies.load_learned("sac-extreme"), tmp_path / "a.onnx")
        assert not list(tmp_path.iterdir())
