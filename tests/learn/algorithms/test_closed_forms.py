"""Learners on a chain of three states whose values are known, in episodes of several steps.

The states are one-hot, and follow each other whatever is done. Rewards are 1, 2 and 3; with a
discount of 1/2 the values are, where the episode ends after the third state,

    V_3 = 3,   V_2 = 2 + V_3 / 2 = 3.5,   V_1 = 1 + V_2 / 2 = 2.75,

and where the first follows on the third for ever, (r_k + r_(k+1) / 2 + r_(k+2) / 4) / (1 - 1/8).
Agent 1 is given minus twice the rewards of agent 0. Episodes begin in any state, so that what comes
after an end says nothing of what would have come without it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from uuvsim_cosim.learn.algorithms.registry import ALGORITHMS, learner_of
from uuvsim_cosim.learn.algorithms.replay_buffer import Transitions
from uuvsim_cosim.learn.data.dataset import Dataset, Episode
from uuvsim_cosim.learn.offline.iql import Iql, IqlSettings
from uuvsim_cosim.learn.policies.policy import Named

Array = NDArray[np.float32]
N, GAMMA = 8, 0.5
REWARDS = np.array([1.0, 2.0, 3.0])
OF_AGENTS = np.array([1.0, -2.0])
ONES = np.eye(3, dtype=np.float32)
ENDED = np.array([2.75, 3.5, 3.0])
FOR_EVER = np.array([REWARDS @ np.roll([1, 0.5, 0.25], k) for k in range(3)]) / (1 - 1 / 8)
CUT = {"ended": 3, "cut short": 4}  # actions of an episode, at most
VALUES = {"ended": ENDED, "cut short": FOR_EVER}
PPO, SAC, DQN = ("ppo", "ippo", "mappo"), ("sac", "masac", "isac"), ("dqn", "idqn")
LOG_2 = math.log(2.0)  # the greatest entropy of an action in [-1, 1]


def made(name: str, **more: Any) -> Any:
    torch.set_num_threads(1)
    given: dict[str, Any] = {"hidden": 32, "layers": 1, "lr": 1e-2, "batch": 64, "gamma": GAMMA}
    if name in PPO:
        given |= {"samples": 160, "epochs": 8, "gae_lambda": 0.8}  # 20 steps: within an episode
    else:
        given |= {"warm_up": 64, "buffer": 1000, "tau": 0.05, "updates": 2.0}
    return learner_of(
        ALGORITHMS[name], {**given, **more}, agents=agents_of(name), observed=3, acted=1, n=N,
        seed=0,
    )  # fmt: skip


def agents_of(name: str) -> int:
    return 1 if ALGORITHMS[name].alone else 2


class Chain:
    """N chains side by side, each somewhere else in its episode."""

    def __init__(self, agents: int, end: str, paid: Callable[[Array], Array] | None = None) -> None:
        self.agents, self.end, self.paid = agents, end, paid
        self._random = np.random.default_rng(0)
        self.state, self.age = self._random.integers(0, 3, N), np.arange(N) % (CUT[end] - 2)

    def seen(self, state: NDArray[Any]) -> Array:
        return np.repeat(ONES[state][:, None], self.agents, 1)

    def step(self, learner: Any) -> tuple[Transitions, NDArray[np.bool_]]:
        before, action = self.seen(self.state), learner.act(self.seen(self.state))
        reward = REWARDS[self.state][:, None] * OF_AGENTS[: self.agents]
        if self.paid is not None:
            reward = reward + self.paid(action)
        ended = (self.state == 2) & (self.end == "ended")
        self.state, self.age = (self.state + 1) % 3, self.age + 1
        lived = Transitions(
            before, action, reward.astype(np.float32), self.seen(self.state),
            np.repeat(ended[:, None], self.agents, 1).astype(np.float32),
        )  # fmt: skip
        over = ended | (self.age == CUT[self.end])
        learner.learn(lived, over)
        self.state = np.where(over, self._random.integers(0, 3, N), self.state)
        self.age[over] = 0
        return lived, over


def taught(name: str, end: str, steps: int, paid: Any = None, **more: Any) -> Any:
    learner = made(name, **more)
    chain = Chain(agents_of(name), end, paid)
    for _ in range(steps):
        chain.step(learner)
    return learner


def each(learner: Any) -> torch.Tensor:
    """The three states, as all agents see them (3, N, 3)."""
    return torch.from_numpy(np.repeat(ONES[:, None], agents_of(learner.name), 1))


# ---- PPO ----------------------------------------------------------------------------------


@torch.no_grad()
def values(learner: Any, seen: torch.Tensor) -> Array:
    """The values (n, N) of what is seen (n, N, 3)."""
    return np.asarray(learner._values(seen).numpy())


@pytest.mark.parametrize("name", PPO)
@pytest.mark.parametrize("end", CUT)
def test_values_of_ppo_are_those_of_the_chain(name: str, end: str) -> None:
    learner = taught(name, end, 1000)
    expected = VALUES[end][:, None] * OF_AGENTS[: agents_of(name)]
    assert values(learner, each(learner)) == pytest.approx(expected, abs=0.25)


def advantages(learner: Any, monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Array]]:
    """What each update is made of: advantages and goals of values (T, N, agents)."""
    kept: list[dict[str, Array]] = []
    descend, update = learner._descend, learner._update
    rows: list[Any] = []

    def noted(columns: Any) -> Any:
        rows.clear()
        given = update(columns)
        T, count = len(columns["reward"]), len(columns["reward"]) * N
        found = {}
        # An epoch's batches are all rows in some order: their observations' places say which.
        order = np.concatenate([r["place"] for r in rows])[:count]
        for k in ("advantage", "goal"):
            flat = np.empty((count, learner.agents), np.float32)
            flat[order] = np.concatenate([r[k] for r in rows])[:count]
            found[k] = flat.reshape(T, N, -1)
        kept.append(found)
        return given

    def one(batch: Any) -> Any:
        rows.append({k: np.asarray(batch[k]) for k in ("advantage", "goal")}
                    | {"place": np.asarray(batch["place"])})  # fmt: skip
        return descend({k: x for k, x in batch.items() if k != "place"})

    def placed(columns: Any) -> Any:
        shape = columns["reward"].shape[:2]
        return noted({**columns, "place": torch.arange(shape[0] * shape[1]).view(shape)})

    monkeypatch.setattr(learner, "_descend", one)
    monkeypatch.setattr(learner, "_update", placed)
    return kept


@pytest.mark.parametrize("name", PPO)
@pytest.mark.parametrize("end", CUT)
def test_an_advantage_is_the_sum_of_the_errors_to_come_in_its_own_episode_and_horizon(
    name: str, end: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A_t = sum_k (gamma lambda)^k delta_(t+k), up to the end of the episode or of the horizon."""
    learner, lam = made(name), 0.8
    found, chain = advantages(learner, monkeypatch), Chain(agents_of(name), end)
    for horizon in range(3):
        delta, cut, v = [], [], []
        for _ in range(20):
            before = values(learner, torch.from_numpy(chain.seen(chain.state)))
            after = values(learner, torch.from_numpy(chain.seen((chain.state + 1) % 3)))
            lived, over = chain.step(learner)
            v.append(before)
            delta.append(lived.reward + GAMMA * (1 - lived.terminated) * after - before)
            cut.append(over)
        assert len(found) == horizon + 1
        assert sum(c.any() for c in cut) > 3  # episodes end within,
        assert not np.all(cut[-1])  # and the horizon within an episode
        expected = np.zeros_like(np.stack(delta))
        for i, t in itertools.product(range(N), range(20)):
            for k in range(t, 20):
                expected[t, i] += (GAMMA * lam) ** (k - t) * delta[k][i]
                if cut[k][i]:
                    break
        assert found[horizon]["advantage"] == pytest.approx(expected, abs=1e-4)
        assert found[horizon]["goal"] == pytest.approx(expected + np.stack(v), abs=1e-4)


@pytest.mark.parametrize("name", ["ippo", "mappo"])
def test_what_comes_after_an_agents_own_end_is_no_merit_of_its_last_action(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One agent of a team ends before its episode does."""
    learner = made(name, samples=2 * N)
    found, o = advantages(learner, monkeypatch), np.zeros((N, 2, 3), np.float32)
    first = float(values(learner, torch.from_numpy(o))[0, 0])
    for step, ended in enumerate(([1.0, 0.0], [0.0, 0.0])):
        learner.act(o)
        paid = np.full((N, 2), 100.0 * step, np.float32)
        gone = np.tile(np.float32(ended), (N, 1))
        learner.learn(Transitions(o, np.zeros((N, 2, 1), np.float32), paid, o, gone),
                      np.zeros(N, bool))  # fmt: skip
    advantage = found[0]["advantage"]
    assert advantage[0, :, 0] == pytest.approx(-first, abs=1e-5)
    assert np.all(advantage[0, :, 1] > 30.0)


@pytest.mark.parametrize("name", PPO)
def test_the_entropy_bonus_of_ppo_sets_its_deviation(name: str) -> None:
    """Where one action is the best, the deviation falls; a bonus of weight 3 makes it rise instead.

    The normalised advantage's derivative by log sigma is at most of size 1, the entropy's is 1.
    """

    def paid(action: Array) -> Array:
        return np.asarray(-2.0 * (action[:, :, 0] - 0.2) ** 2)

    spread = {}
    for bonus in (0.0, 3.0):
        learner = taught(name, "ended", 300, paid, entropy=bonus, log_std=-1.0, lr=3e-3)
        spread[bonus] = float(learner.log_std.detach().mean())
    assert spread[0.0] < -1.05
    assert spread[3.0] > -0.95


# ---- SAC ----------------------------------------------------------------------------------


@torch.no_grad()
def soft_values(learner: Any) -> Array:
    """Q (3, N), the mean of both critics and of actions drawn evenly."""
    m, random = learner.masac, torch.Generator().manual_seed(0)
    states = each(learner).transpose(0, 1).repeat_interleave(50, 1)
    actions = 2 * torch.rand(*states.shape[:2], 1, generator=random) - 1
    q = m._q(m.critic, m._seen(states, actions)).mean(1)
    return np.asarray(q.view(m.agents, 3, 50).mean(-1).T.numpy())


def entropies(learner: Any) -> NDArray[np.float64]:
    """The entropy of each agent's actions, over the three states."""
    m = learner.masac
    with torch.no_grad():
        _, log_pi = m._drawn(each(learner).transpose(0, 1).repeat_interleave(500, 1))
    return np.asarray(-log_pi.mean(1).numpy(), float)


@pytest.mark.parametrize(
    ("name", "shared"),
    [*((n, False) for n in SAC), ("masac", True), ("isac", True)],
)
@pytest.mark.parametrize("end", CUT)
def test_values_of_sac_are_those_of_the_chain_with_the_bonus_of_entropy(
    name: str, shared: bool, end: str
) -> None:
    """Nothing depends on the action, so all are drawn evenly, of entropy log 2 in each state.

    Q_k = r_k + gamma (Q_(k+1) + alpha log 2): each further state adds its bonus.
    """
    alpha = 1.0
    more = {"shared": True} if shared else {}
    learner = taught(name, end, 500, alpha=alpha, tune_alpha=False, lr=3e-3, **more)
    assert entropies(learner) == pytest.approx(LOG_2, abs=0.06)
    later = {"ended": np.array([0.75, 0.5, 0.0]), "cut short": np.ones(3)}[end]
    bonus = alpha * LOG_2 * later[:, None]  # gamma + gamma², gamma, 0; gamma / (1 - gamma)
    own = np.array([1.0, 1.0]) if shared else OF_AGENTS
    if shared:  # one critic for both is given the rewards of both: their mean, told apart by nobody
        expected = VALUES[end][:, None] * OF_AGENTS.mean() * own + bonus
        assert soft_values(learner).mean(1) == pytest.approx(expected.mean(1), abs=0.3)
        return
    expected = VALUES[end][:, None] * own[: agents_of(name)] + bonus
    assert soft_values(learner) == pytest.approx(expected, abs=0.3)


@pytest.mark.parametrize("name", SAC)
def test_an_actor_of_sac_spreads_as_its_temperature_wants(name: str) -> None:
    """Rewards -k (a - 0.2)² give pi ~ exp(r / alpha): deviation sqrt(alpha / (2 k)) about 0.2."""
    k, alpha = 4.0, 0.1

    def paid(action: Array) -> Array:
        return np.asarray(-k * (action[:, :, 0] - 0.2) ** 2)

    learner = taught(name, "ended", 700, paid, alpha=alpha, tune_alpha=False, lr=3e-3, layers=2)
    chain = Chain(agents_of(name), "ended")
    drawn = np.concatenate([learner.act(chain.seen(np.arange(3).repeat(200))) for _ in range(3)])
    for i in range(agents_of(name)):
        assert drawn[:, i].mean() == pytest.approx(0.2, abs=0.06)
        assert drawn[:, i].std() == pytest.approx(math.sqrt(alpha / (2 * k)), rel=0.25)


@pytest.mark.parametrize("name", SAC)
@pytest.mark.parametrize(("log_std", "sign"), [(0.0, -1.0), (-5.0, 1.0)])
def test_a_temperature_falls_where_there_is_more_entropy_than_wanted_and_else_rises(
    name: str, log_std: float, sign: float
) -> None:
    """Adam's first step is the learning rate, whatever the gradient's size."""
    learner = made(name, alpha=0.3, updates=1.0, lr=1e-2)
    chain = Chain(agents_of(name), "ended")
    for _ in range(7):
        chain.step(learner)
    with torch.no_grad():
        learner.masac.actor.weights[-1].zero_()
        learner.masac.actor.biases[-1][..., 1] = log_std
    chain.step(learner)  # 64 environment steps: the first update
    assert learner._updates == 1
    assert learner.masac.log_alpha.detach().numpy() == pytest.approx(
        math.log(0.3) + sign * 1e-2, abs=1e-4
    )


# ---- DQN ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", DQN)
@pytest.mark.parametrize("end", CUT)
def test_values_of_dqn_are_those_of_the_chain_less_what_an_action_costs(
    name: str, end: str
) -> None:
    """With a cost (a - 1/2)² the best of the five levels costs nothing: Q = V - (a - 1/2)²."""

    def paid(action: Array) -> Array:
        return np.asarray(-((action[:, :, 0] - 0.5) ** 2))

    learner = taught(name, end, 700, paid, epsilon_end=1.0, lr=3e-3)
    with torch.no_grad():
        seen = each(learner)
        q = learner.network(seen.transpose(0, 1)).transpose(0, 1).numpy()
    cost = (learner.grid[:, 0] - 0.5) ** 2
    expected = (VALUES[end][:, None] * OF_AGENTS[: agents_of(name)])[:, :, None] - cost
    assert q == pytest.approx(expected, abs=0.3)
    greedy = learner.act(seen.numpy(), explore=False)
    assert np.all(greedy == 0.5)


@pytest.mark.parametrize("name", DQN)
def test_dqn_explores_by_the_share_that_its_steps_say(name: str) -> None:
    learner = made(name, epsilon=1.0, epsilon_end=0.2, epsilon_steps=80)
    chain, shares = Chain(agents_of(name), "ended"), []
    for _ in range(13):
        shares.append(learner.epsilon)
        chain.step(learner)
    assert shares == pytest.approx([max(1.0 - 0.8 * k * N / 80, 0.2) for k in range(13)])
    seen = chain.seen(np.zeros(4000, int))
    greedy = learner.act(seen, explore=False)
    other = (learner.act(seen) != greedy).mean()
    assert other == pytest.approx(0.2 * 4 / 5, abs=0.03)  # one of five is the greedy one


# ---- IQL ----------------------------------------------------------------------------------


def walks(end: str) -> Dataset:
    """60 walks; actions are ±1, as often, and pay 1 or 0 on top of nothing."""
    random, episodes = np.random.default_rng(0), []
    for first in np.arange(60) % 3:
        T = 3 - first if end == "ended" else 6
        state = (first + np.arange(T + 1)) % 3
        action = random.choice([-1.0, 1.0], (T, 1)).astype(np.float32)
        reward = (action[:, 0] > 0).astype(np.float32)
        episodes.append(Episode(ONES[state], action, reward, end == "ended"))
    seen = tuple(Named(f"o[{k}]", 0.0, 1.0) for k in range(3))
    return Dataset(episodes, seen, (Named("a", -1.0, 1.0),), "")


@pytest.mark.parametrize("end", CUT)
@pytest.mark.parametrize("expectile", [0.5, 0.8])
def test_values_of_iql_are_expectiles_of_what_was_done(end: str, expectile: float) -> None:
    """Of 0 and 1, as often, the expectile is tau: V_3 = tau, V_2 = tau + gamma V_3 and so on.

    And the policy is the mean of ±1 with weights exp(±beta), as advantages are in units of their
    mean size: tanh(beta).
    """
    beta = 0.5
    given = IqlSettings(
        lr=3e-3, batch=128, hidden=32, gamma=GAMMA, tau=0.05, expectile=expectile, beta=beta
    )
    torch.set_num_threads(1)
    iql = Iql(walks(end), given, 0)
    for _ in range(900):
        iql.update()
    rows = torch.from_numpy((ONES - iql._rows.shift) * iql._rows.scale)
    with torch.no_grad():
        v = iql.value(rows[None])[0, :, 0].numpy()
        mean = torch.tanh(iql.actor(rows[None])[0, :, 0]).numpy()
        both = torch.cat([rows.repeat(2, 1), torch.tensor([[-1.0]] * 3 + [[1.0]] * 3)], 1)
        q = iql.critic(both.expand(2, -1, -1)).mean(0)[:, 0].numpy()
    later = {"ended": np.array([1.75, 1.5, 1.0]), "cut short": np.full(3, 2.0)}[end]
    assert v == pytest.approx(expectile * later, abs=0.12)
    assert q == pytest.approx(
        np.concatenate([expectile * (later - 1.0), 1.0 + expectile * (later - 1.0)]), abs=0.12
    )
    assert mean == pytest.approx(math.tanh(beta), abs=0.12)
