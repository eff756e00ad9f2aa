"""One mission through PettingZoo: every AUV is an agent of its own and moves at random."""

from usvauv.env import parallel_env


def main(max_steps: int = 1000) -> dict[str, float]:
    """Run a mission for at most `max_steps` steps; prints and returns each agent's sum of rewards."""
    env = parallel_env(scenario="extreme")
    env.reset(seed=0)
    for k, agent in enumerate(env.agents):
        env.action_space(agent).seed(k)
    total = dict.fromkeys(env.agents, 0.0)
    for _ in range(max_steps):
        actions = {agent: env.action_space(agent).sample() for agent in env.agents}
        _, rewards, _, _, _ = env.step(actions)
        for agent, reward in rewards.items():
            total[agent] += reward
        if not env.agents:
            break
    env.close()
    print("  ".join(f"{agent}: {value:.1f}" for agent, value in total.items()))
    return total


if __name__ == "__main__":
    main()
