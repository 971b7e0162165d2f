"""A decision transformer acts as torch's does, as a component, in a kernel and as an FMU."""

import math
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
import torch
from torch import Tensor, nn

from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.kernels.kernel import fuse
from uuvsim_cosim.learn.deployment.export import policy_model
from uuvsim_cosim.learn.policies.policy import Named, Policy
from uuvsim_cosim.models.intrinsics.transformer import transformer
from uuvsim_cosim.orchestrator.system.system import System

OBSERVED, ACTED, HIDDEN, HEADS, K, TIMES = 5, 2, 24, 3, 4, 9


class Block(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        h = HIDDEN
        self.norm_1, self.norm_2 = nn.LayerNorm(h), nn.LayerNorm(h)
        self.attention = nn.ModuleDict({"qkv": nn.Linear(h, 3 * h), "out": nn.Linear(h, h)})
        self.wide, self.narrow = nn.Linear(h, 4 * h), nn.Linear(4 * h, h)

    def forward(self, x: Tensor) -> Tensor:
        n = len(x)
        parts = self.attention["qkv"](self.norm_1(x)).chunk(3, 1)
        q, k, v = (p.reshape(n, HEADS, -1).transpose(0, 1) for p in parts)
        score = q @ k.transpose(1, 2) / math.sqrt(HIDDEN // HEADS)
        causal = torch.ones(n, n, dtype=torch.bool).tril()
        mixed = score.masked_fill(~causal, -math.inf).softmax(2) @ v
        x = x + self.attention["out"](mixed.transpose(0, 1).reshape(n, -1))
        y: Tensor = x + self.narrow(nn.functional.gelu(self.wide(self.norm_2(x))))
        return y


class Decision(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        h = HIDDEN
        self.embed_return, self.embed_observation = nn.Linear(1, h), nn.Linear(OBSERVED, h)
        self.embed_action, self.embed_time = nn.Linear(ACTED, h), nn.Embedding(TIMES, h)
        self.embed_norm, self.norm, self.head = nn.LayerNorm(h), nn.LayerNorm(h), nn.Linear(h, 2)
        self.blocks = nn.ModuleList(Block() for _ in range(2))

    def forward(self, R: Tensor, o: Tensor, a: Tensor, t: Tensor) -> Tensor:
        parts = (self.embed_return(R), self.embed_observation(o), self.embed_action(a))
        x = torch.stack([p + self.embed_time(t) for p in parts], 1).reshape(-1, HIDDEN)
        x = self.embed_norm(x)
        for block in self.blocks:
            x = block(x)
        return torch.tanh(self.head(self.norm(x[-2:-1]))[0])


@pytest.fixture(scope="module")
def net() -> Decision:
    torch.manual_seed(0)
    torch.set_num_threads(1)
    return Decision().requires_grad_(False)


@pytest.fixture(scope="module")
def policy(net: Decision) -> Policy:
    return Policy(
        kind="sequence",
        tensors={k: v.numpy().copy() for k, v in net.state_dict().items()},
        observation=tuple(Named(f"o[{i}]", -3.0, 3.0) for i in range(OBSERVED)),
        action=tuple(Named(f"a[{i}]", -1.0, 1.0) for i in range(ACTED)),
        task="my:Task",
        settings={"context": K, "heads": HEADS, "activation": "gelu", "return_to_go": 50.0,
                  "return_scale": 10.0, "reward": 2.0},
    )  # fmt: skip


def lived(net: Decision, seen: np.ndarray, rewards: np.ndarray) -> np.ndarray:
    """Act in torch, on the history that grows to K places and then moves on."""
    R, done = [50.0], np.zeros((0, ACTED))
    for t, _ in enumerate(seen):
        if t:
            R.append(R[-1] - rewards[t])
        first = max(0, t + 1 - K)
        rows = (np.array(R)[first:, None] / 10.0, seen[first : t + 1],
                np.vstack([done, np.zeros((1, ACTED))])[first:])  # fmt: skip
        times = torch.arange(first, t + 1).clamp(0, TIMES - 1)
        acted = net(*(torch.from_numpy(r.astype(np.float32)) for r in rows), times).numpy()
        done = np.vstack([done, acted])
    return done


def test_it_acts_as_torch_within_1e_6_along_its_history(net: Decision, policy: Policy) -> None:
    r = np.random.default_rng(1)
    seen, rewards = r.uniform(-2, 2, (14, OBSERVED)), r.uniform(0, 4, 14)
    component = Native(policy_model(policy, plain=True), "p")
    v = component.description.variables
    component.enter_initialization_mode(0.0, None)
    component.exit_initialization_mode()
    got = []
    for t in range(14):
        component.set(v["observation"], seen[t])
        component.set(v["reward"], rewards[t])
        component.do_step(t / 10, 0.1)
        got.append(component.get(v["action"]))
    assert np.abs(np.array(got) - lived(net, seen, rewards)).max() < 1e-6


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_lanes_act_as_the_component_does(policy: Policy, dtype: str, tmp_path: Path) -> None:
    source = f"policy:{policy.save(tmp_path / 'dt.npz')}?plain=1"
    seen = np.random.default_rng(2).uniform(-2, 2, (9, OBSERVED))
    kernel = fuse(System("one", "0.1").add("p", source), dtype=dtype)
    with kernel.batch(9, start={"p.observation": seen}) as batch:
        batch.step(6)
        got = batch.get("p.action")
    one = Native(policy_model(policy, plain=True), "p")
    for i, row in enumerate(seen):
        c = one.another("p")
        c.enter_initialization_mode(0.0, None)
        c.set(c.description.variables["observation"], row)
        c.exit_initialization_mode()
        for k in range(6):
            c.do_step(k / 10, 0.1)
        want = c.get(c.description.variables["action"])
        if dtype == "float64":
            assert np.array_equal(got[i], want)
        else:
            assert np.allclose(got[i], want, atol=1e-5)


def test_casadi_evaluates_it_too(net: Decision, policy: Policy) -> None:
    call = transformer(policy.tensors, K, HEADS, "gelu")
    rows = np.random.default_rng(3).normal(size=(K, 1 + OBSERVED + ACTED)).astype(np.float32)
    at = ca.SX.sym("x", 1 + rows.size)
    got = np.tanh(np.array(ca.Function("f", [at], [call(at)])([20, *rows.ravel()])).ravel())
    R, o, a = (torch.from_numpy(x) for x in np.split(rows, [1, 1 + OBSERVED], axis=1))
    times = torch.full((K,), TIMES - 1)
    assert np.abs(got - net(R, o, a, times).numpy()).max() < 1e-6


def test_what_does_not_fit_is_refused(policy: Policy, tmp_path: Path) -> None:
    tensors: dict[str, Any] = dict(policy.tensors)
    with pytest.raises(ParameterInvalid, match="5 heads of 24"):
        transformer(tensors, K, 5, "gelu")
    del tensors["blocks.1.attention.out.bias"]
    with pytest.raises(ParameterInvalid, match=r"blocks\.1\.attention\.out\.bias': none"):
        transformer(tensors, K, HEADS, "gelu")
    from dataclasses import replace

    with pytest.raises(InputInvalid, match="'context'"):
        policy_model(replace(policy, settings={}), plain=True)
