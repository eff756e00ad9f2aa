"""Proximal policy optimisation with TorchRL's collector and losses: one actor and one critic shared by all AUVs.

The worlds, the networks and the batches stay on one device. Install and run:

    pip install -c constraints.txt -e ".[torchrl]"
    python examples/torchrl_ppo.py --steps 6000
"""

import argparse
from collections.abc import Sequence

import torch
from tensordict.nn import TensorDictModule
from torchrl.collectors import Collector
from torchrl.data import LazyTensorStorage, ReplayBuffer
from torchrl.data.replay_buffers.samplers import SamplerWithoutReplacement
from torchrl.modules import MultiAgentMLP, NormalParamExtractor, ProbabilisticActor, TanhNormal
from torchrl.objectives import ValueEstimators
from torchrl.objectives.multiagent import IPPOLoss

from usvauv.env.interfaces.torchrl_env import DataCollectionTorchRLEnv

VALUE, LOG_PROB = ("agents", "state_value"), ("agents", "action_log_prob")


def networks(env: DataCollectionTorchRLEnv) -> tuple[ProbabilisticActor, TensorDictModule]:
    """Actor and critic; each AUV's output depends on its own observation only."""
    num_auvs, observation_size = env.observation_spec["agents", "observation"].shape[-2:]
    action = env.full_action_spec_unbatched
    action_size = action[env.action_key].shape[-1]

    def perceptron(outputs: int) -> MultiAgentMLP:
        return MultiAgentMLP(
            n_agent_inputs=observation_size,
            n_agent_outputs=outputs,
            n_agents=num_auvs,
            centralized=False,
            share_params=True,
            depth=2,
            num_cells=64,
            activation_class=torch.nn.Tanh,
            device=env.device,
        )

    moments = [("agents", "loc"), ("agents", "scale")]
    normal = torch.nn.Sequential(perceptron(2 * action_size), NormalParamExtractor())
    actor = ProbabilisticActor(
        TensorDictModule(normal, in_keys=[("agents", "observation")], out_keys=moments),
        spec=action,
        in_keys=moments,
        out_keys=[env.action_key],
        distribution_class=TanhNormal,
        return_log_prob=True,
        log_prob_key=LOG_PROB,
    )
    return actor, TensorDictModule(perceptron(1), in_keys=[("agents", "observation")], out_keys=[VALUE])


def main(arguments: Sequence[str] | None = None) -> list[float]:
    """Learn for `--steps` mission steps; prints and returns the mean team reward per step of each batch."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=6000)
    parser.add_argument("--worlds", type=int, default=64)
    parser.add_argument("--scenario", default="extreme")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--horizon", type=int, default=50, help="steps between two rounds of learning")
    parser.add_argument("--epochs", type=int, default=6)
    parser.add_argument("--minibatch", type=int, default=800, help="world-steps")
    parser.add_argument("--reward-scale", type=float, default=0.1)
    asked = parser.parse_args(arguments)

    torch.manual_seed(asked.seed)
    env = DataCollectionTorchRLEnv(asked.scenario, asked.worlds, asked.seed)
    actor, critic = networks(env)
    loss = IPPOLoss(actor, critic, clip_epsilon=0.2, entropy_coeff=0.002)
    loss.set_keys(reward=env.reward_key, action=env.action_key, value=VALUE, sample_log_prob=LOG_PROB)
    loss.make_value_estimator(ValueEstimators.MAGAE, gamma=0.95, lmbda=0.9)
    optimiser = torch.optim.Adam(loss.parameters(), lr=1e-3)

    frames = asked.worlds * asked.horizon
    total = asked.steps * asked.worlds
    collector = Collector(
        env, actor, frames_per_batch=frames, total_frames=total, auto_register_policy_transforms=False
    )
    storage = LazyTensorStorage(frames, device=env.device)
    minibatches = ReplayBuffer(storage=storage, sampler=SamplerWithoutReplacement(), batch_size=asked.minibatch)

    means = []
    for batch in collector:
        reward = batch["next", "agents", "reward"]
        means.append(float(reward.sum(-2).mean()))
        reward.mul_(asked.reward_scale)
        with torch.no_grad():
            loss.value_estimator(
                batch, params=loss.critic_network_params, target_params=loss.target_critic_network_params
            )
        minibatches.extend(batch.reshape(-1))
        for _ in range(asked.epochs):
            for part in minibatches:
                terms = loss(part)
                optimiser.zero_grad()
                (terms["loss_objective"] + terms["loss_critic"] + terms["loss_entropy"]).backward()
                torch.nn.utils.clip_grad_norm_(loss.parameters(), 1.0)
                optimiser.step()
        print(f"step {len(means) * asked.horizon}: mean team reward {means[-1]:.2f} per step")
    collector.shutdown()
    return means


if __name__ == "__main__":
    main()
