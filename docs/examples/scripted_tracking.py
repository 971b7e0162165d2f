"""Two vehicles that a hand-written controller drives stay with a moving target, as PettingZoo."""

from uuvsim_cosim.envs import CosimParallelEnv
from uuvsim_cosim.envs.tasks import evaluate, scripted_policy
from uuvsim_cosim.envs.tasks.tracking_scenarios import target


def main() -> None:
    task = target()
    policies = scripted_policy(task)

    env = CosimParallelEnv(task)
    observations, infos = env.reset(seed=3)
    while env.agents:
        actions = {agent: policies[agent](observations[agent][None])[0] for agent in env.agents}
        observations, rewards, _, _, infos = env.step(actions)
    print(f"one episode ends with {rewards} and the target {infos['tracker_1']['dist']:.2f} m off")
    env.close()

    many = evaluate(task, policies, episodes=100).summary()
    print("100 episodes:", {name: round(value, 3) for name, value in many.items()})


if __name__ == "__main__":
    main()
