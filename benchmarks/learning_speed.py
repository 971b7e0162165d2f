"""Learning, end to end: our SAC beside stable-baselines3's on the same task, in the same run.

Target tracking's source scenario (one `pool8` in its fused kernel), 64 environments, two layers of
256 (--hidden), batch 256, 4 updates for each step of all environments, one torch thread. Medians of
CPU time. With --returns both learn 25,600 steps and are judged on the same 100 held-out episodes,
which is the check of the one by the other.

    python benchmarks/learning_speed.py --returns 3
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import SAC

from uuvsim_cosim.envs.sb3 import Sb3VecEnv
from uuvsim_cosim.envs.tasks.evaluation import evaluate
from uuvsim_cosim.envs.tasks.scripted import scripted_policy
from uuvsim_cosim.learn.algorithms.masac import MasacSettings
from uuvsim_cosim.learn.algorithms.off_policy_learner import MasacLearner, OffPolicySettings
from uuvsim_cosim.learn.shared.task_ids import make_task
from uuvsim_cosim.learn.training.rollout import Rollout
from uuvsim_cosim.learn.training.train import train
from uuvsim_cosim.learn.training.training_seeds import JUDGING_SEED

ENVS, UPDATES, BATCH = 64, 4, 256


def ours(hidden: int) -> tuple[Rollout, MasacLearner]:
    rollout = Rollout(make_task("source"), ENVS, 0)
    schedule = OffPolicySettings(warm_up=500, updates=UPDATES, batch=BATCH)
    network = MasacSettings(hidden=hidden)
    widths = rollout.observed, rollout.acted
    return rollout, MasacLearner(1, *widths, network=network, schedule=schedule)


def theirs(seed: int = 0, hidden: int = 256) -> SAC:
    env = Sb3VecEnv(make_task("source"), ENVS)
    env.seed(seed)
    return SAC(
        "MlpPolicy", env, learning_rate=3e-4, buffer_size=100_000, learning_starts=500,
        batch_size=BATCH, tau=0.01, gamma=0.99, train_freq=1, gradient_steps=UPDATES,
        ent_coef="auto_0.2", policy_kwargs={"net_arch": [hidden, hidden]}, seed=seed, device="cpu",
    )  # fmt: skip


def live(rollout: Rollout, learner: MasacLearner, steps: int) -> None:
    for _ in range(steps):
        lived, _ = rollout.step(learner.act(rollout.observation))
        learner.learn(lived, rollout.steps == 0)


def median(call: Callable[[], object], repeats: int) -> float:
    times = []
    for _ in range(repeats):
        began = time.process_time()
        call()
        times.append(time.process_time() - began)
    return statistics.median(times)


def speeds(repeats: int, hidden: int) -> None:
    rollout, learner = ours(hidden)
    model = theirs(hidden=hidden)
    live(rollout, learner, 20)
    model.learn(20 * ENVS)
    buffer = learner._replay
    random = np.random.default_rng(0)
    actions = random.uniform(-1, 1, (ENVS, 1, rollout.acted)).astype(np.float32)
    vector = model.env
    assert vector is not None
    k = 40

    def stepped(act: Callable[[], Any]) -> Callable[[], None]:
        def call() -> None:
            for _ in range(k):
                act()

        return call

    rows = [
        ("environment steps/s, without learning", ENVS * k,
         stepped(lambda: rollout.step(actions)), stepped(lambda: vector.step(actions[:, 0]))),
        ("gradient updates/s", k,
         stepped(lambda: learner.masac.update(buffer.draw(BATCH, random))),
         lambda: model.train(k, BATCH)),
        (f"environment steps/s, learning ({UPDATES} updates a step of {ENVS})", ENVS * k,
         lambda: live(rollout, learner, k),
         lambda: model.learn(ENVS * k, reset_num_timesteps=False)),
    ]  # fmt: skip
    print(f"{'':58} {'ours':>9} {'sb3':>9} {'ratio':>7}")
    for name, count, own, other in rows:
        a, b = count / median(own, repeats), count / median(other, repeats)
        print(f"{name:58} {a:9.0f} {b:9.0f} {a / b:7.2f}")


def returns(seeds: int) -> None:
    task = make_task("source")

    def judged(policy: Any) -> float:
        act = dict.fromkeys(task.agents, policy)  # type: ignore[union-attr]
        return float(evaluate(task, act, 100, seed=JUDGING_SEED).returns.mean())

    scripted = next(iter(scripted_policy(task).values()))  # type: ignore[union-attr]
    print(f"return of 100 episodes after 25,600 steps; scripted {judged(scripted):.1f}")
    for seed in range(seeds):
        with tempfile.TemporaryDirectory() as folder:
            began = time.process_time()
            done = train(
                "source", algorithm="sac", seed=100 * seed, steps=25_600, evaluate_every=25_600,
                evaluation_episodes=1, folder=Path(folder) / "t", tensorboard=False,
            )  # fmt: skip
            own = time.process_time() - began, judged(done.policies("policy")["agent"])
        began = time.process_time()
        model = theirs(100 * seed).learn(25_600)
        taken = time.process_time() - began
        other = taken, judged(lambda o, m=model: m.predict(o, deterministic=True)[0])
        print(f"  seed {100 * seed:3}: ours {own[1]:6.1f} ({own[0]:.0f} CPU s)"
              f"   sb3 {other[1]:6.1f} ({other[0]:.0f} CPU s)")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--hidden", type=int, default=256, help="of the speeds")
    parser.add_argument("--returns", type=int, default=0, metavar="SEEDS")
    given = parser.parse_args()
    torch.set_num_threads(1)
    speeds(given.repeats, given.hidden)
    if given.returns:
        returns(given.returns)


if __name__ == "__main__":
    main()
