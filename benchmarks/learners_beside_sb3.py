"""Our PPO and DQN beside stable-baselines3's: the same task, numbers and steps, ten seeds each.

Target tracking's source scenario (one `pool8` in its fused kernel), 64 environments, two layers of
256, one torch thread. Each training is evaluated on the same 100 held-out episodes. Printed are the
returns of each seed, their mean with a 95 % bootstrap interval over the seeds, the difference of
the means with its interval, and CPU seconds.

    python benchmarks/learners_beside_sb3.py --seeds 10
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.vec_env import VecEnvWrapper
from torch import nn

from uuvsim_cosim.envs.sb3 import Sb3VecEnv
from uuvsim_cosim.envs.tasks.evaluation import evaluate
from uuvsim_cosim.learn.algorithms.dqn import DqnSettings, action_grid
from uuvsim_cosim.learn.algorithms.ppo import PpoSettings
from uuvsim_cosim.learn.shared.task_ids import make_task
from uuvsim_cosim.learn.training.train import train
from uuvsim_cosim.learn.training.training_seeds import JUDGING_SEED

ENVS = 64


def judged(policy: Any) -> float:
    """Return the mean return of 100 held-out episodes."""
    task = make_task("source")
    act = dict.fromkeys(task.agents, policy)  # type: ignore[union-attr]
    return float(evaluate(task, act, 100, seed=JUDGING_SEED).returns.mean())


def ours(name: str, seed: int, steps: int) -> float:
    """Train ours, and evaluate what it ends with."""
    with tempfile.TemporaryDirectory() as folder:
        done = train(
            "source", algorithm=name, seed=seed, steps=steps, evaluate_every=steps,
            evaluation_episodes=1, folder=Path(folder) / "t", tensorboard=False,
        )  # fmt: skip
        return judged(done.policies("policy")["agent"])


def ppo(env: Any, seed: int) -> Any:
    """Make stable-baselines3's PPO with the defaults of ours."""
    s = PpoSettings()
    return PPO(
        "MlpPolicy", env, learning_rate=s.lr, n_steps=-(-s.samples // ENVS), batch_size=s.batch,
        n_epochs=s.epochs, gamma=s.gamma, gae_lambda=s.gae_lambda, clip_range=s.clip,
        ent_coef=s.entropy, vf_coef=s.value, max_grad_norm=s.max_norm, device="cpu", seed=seed,
        policy_kwargs={"net_arch": [s.hidden] * s.layers, "activation_fn": nn.ReLU,
                       "log_std_init": s.log_std},
    )  # fmt: skip


def dqn(env: Any, seed: int, steps: int) -> Any:
    """Make stable-baselines3's DQN with the defaults of ours, on the same grid of actions."""
    s = DqnSettings()
    return DQN(
        "MlpPolicy", env, learning_rate=s.lr, buffer_size=s.buffer, batch_size=s.batch, tau=s.tau,
        gamma=s.gamma, target_update_interval=ENVS, train_freq=1, gradient_steps=ENVS // 16,
        learning_starts=s.warm_up, exploration_fraction=s.epsilon_steps / steps,
        exploration_initial_eps=s.epsilon, exploration_final_eps=s.epsilon_end, device="cpu",
        policy_kwargs={"net_arch": [s.hidden] * s.layers}, seed=seed,
    )  # fmt: skip


def on_grid(env: Sb3VecEnv) -> VecEnvWrapper:
    """Return a vector environment whose actions are the rows of `action_grid`."""
    grid = action_grid(env.action_space.shape[0])  # type: ignore[index]

    class OnGrid(VecEnvWrapper):
        def reset(self) -> Any:
            return self.venv.reset()

        def step_async(self, actions: Any) -> None:
            self.venv.step_async(grid[actions])

        def step_wait(self) -> Any:
            return self.venv.step_wait()

    return OnGrid(env, action_space=gymnasium.spaces.Discrete(len(grid)))


def theirs(name: str, seed: int, steps: int) -> float:
    """Train stable-baselines3's, and evaluate what it ends with."""
    env = Sb3VecEnv(make_task("source"), ENVS)
    env.seed(seed)
    if name == "ppo":
        model = ppo(env, seed).learn(steps)
        return judged(lambda o: np.clip(model.predict(o, deterministic=True)[0], -1.0, 1.0))
    grid = action_grid(env.action_space.shape[0])  # type: ignore[index]
    model = dqn(on_grid(env), seed, steps).learn(steps)
    return judged(lambda o: grid[model.predict(o, deterministic=True)[0]])


def interval(draws: np.ndarray) -> str:
    """Return the mean and the 95 % interval of bootstrap draws."""
    low, high = np.quantile(draws, [0.025, 0.975])
    return f"{draws.mean():6.1f} [{low:.1f}, {high:.1f}]"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--steps", type=int, default=51_200)
    parser.add_argument("--only", choices=["ppo", "dqn"])
    given = parser.parse_args()
    torch.set_num_threads(1)
    random = np.random.default_rng(0)
    for name in ("ppo", "dqn"):
        if given.only not in (None, name):
            continue
        found: dict[str, list[float]] = {"ours": [], "sb3": []}
        spent = dict.fromkeys(found, 0.0)
        for seed in range(given.seeds):
            for who, values in found.items():
                began = time.process_time()
                value = (ours(name, seed, given.steps) if who == "ours"
                         else theirs(name, seed, given.steps))  # fmt: skip
                spent[who] += time.process_time() - began
                values.append(value)
            print(f"{name} seed {seed}: " + "  ".join(f"{w} {v[-1]:.1f}" for w, v in found.items()),
                  flush=True)  # fmt: skip
        means = {w: random.choice(v, (10_000, given.seeds)).mean(axis=1) for w, v in found.items()}
        for who, draws in means.items():
            print(f"{name} {who:5} {interval(draws)}   {spent[who] / given.seeds:.0f} CPU s a seed")
        print(f"{name} ours - sb3 {interval(means['ours'] - means['sb3'])}", flush=True)


if __name__ == "__main__":
    main()
