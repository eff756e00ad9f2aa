"""Many missions through Gymnasium: every AUV heads for its target at 70 % of full speed."""

import gymnasium
import numpy as np

from usvauv.env import Scenario  # importing usvauv.env registers the environment
from usvauv.env.world.observation_layout import ObservationLayout


def main(num_envs: int = 512, steps: int = 1000) -> float:
    """Run all missions for `steps` mission steps; prints and returns the mean reward of a team per step."""
    envs = gymnasium.make_vec("usvauv/DataCollection-v0", num_envs=num_envs, scenario="extreme")
    target = ObservationLayout.of(Scenario.load("extreme")).slice("target")
    observation, _ = envs.reset(seed=0)
    total = 0.0
    for _ in range(steps):
        to_target = observation[..., target]
        distance = np.linalg.norm(to_target, axis=-1, keepdims=True)
        action = 0.7 * to_target / np.maximum(distance, 1e-9)
        observation, reward, _, _, _ = envs.step(action)
        total += reward.mean()
    envs.close()
    print(f"{num_envs} missions, {steps} steps: mean team reward {total / steps:.3f} per step")
    return total / steps


if __name__ == "__main__":
    main()
