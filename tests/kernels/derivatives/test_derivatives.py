"""Derivatives through a kernel: finite differences, transposes, and torch's own check."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from uuvsim_cosim.errors import InputInvalid, SystemInvalid
from uuvsim_cosim.kernels import Kernel, fuse
from uuvsim_cosim.kernels.codegen.fusible import fused_of
from uuvsim_cosim.kernels.derivatives import autograd as through_torch
from uuvsim_cosim.kernels.derivatives.rollout import _compiled
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Group
from uuvsim_cosim.orchestrator.system.system import System

N, STEPS = 3, 25
OUTPUTS = ["hull.eta", "hull.nu", "thruster.thrust", "pressure.pressure", "controller.tau_d"]


def closed() -> System:
    """A hull under a sampled controller; a thruster's table and a noisy sensor watch it."""
    system = System("closed", "0.01").add("hull", "model:bluerov2_heavy")
    system = system.add("controller", "model:controller").connect("hull.eta", "controller.eta")
    system = system.connect("hull.nu", "controller.nu").connect("controller.tau_d", "hull.tau")
    system = system.add("thruster", "model:thruster_t200").connect("hull.nu_r", "thruster.nu_r")
    system = system.add("pressure", "model:pressure")
    return system.connect("hull.eta", "pressure.eta")


@pytest.fixture(scope="module")
def kernel() -> Kernel:
    return fuse(closed(), lanes=4)


def given(rng: np.random.Generator) -> tuple[dict[str, Any], dict[str, Any]]:
    """Start values and inputs, each environment's own but for the mass."""
    eta_0 = 0.2 * rng.standard_normal((N, 6)) + np.array([0, 0, 5, 0, 0, 0])
    start = {
        "hull.eta_0": eta_0,
        "hull.nu_0": 0.2 * rng.standard_normal((N, 6)),
        "hull.m": np.array(13.5),
        "thruster.u": 0.3 + 0.1 * rng.random(N),
    }
    wanted = eta_0 + 0.1 * rng.standard_normal((STEPS, N, 6))
    return start, {"controller.eta_d": wanted}


def alike(values: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    return {name: 0.1 * rng.standard_normal(v.shape) for name, v in values.items()}


def values(kernel: Kernel, start: Any, inputs: Any) -> dict[str, np.ndarray]:
    """Plain steps, without derivatives."""
    batch = kernel.batch(N, start=start)
    rows: dict[str, list[np.ndarray]] = {name: [] for name in OUTPUTS}
    for k in range(STEPS):
        batch.set("controller.eta_d", inputs["controller.eta_d"][k])
        batch.step()
        for name in OUTPUTS:
            rows[name].append(batch.get(name))
    return {name: np.array(r) for name, r in rows.items()}


def check(kernel: Kernel, rng: np.random.Generator) -> None:
    start, inputs = given(rng)
    tangents = alike({**start, **inputs}, rng)
    plain, changes = kernel.jvp(start, tangents, OUTPUTS, steps=STEPS, n_envs=N, inputs=inputs)
    e = 1e-4  # the pressure of a depth is rounded at 1e-7 Pa
    moved = [
        values(
            kernel,
            {n: v + sign * e * tangents[n] for n, v in start.items()},
            {n: v + sign * e * tangents[n] for n, v in inputs.items()},
        )
        for sign in (1.0, -1.0)
    ]
    unmoved = values(kernel, start, inputs)
    for name in OUTPUTS:
        assert np.array_equal(plain[name], unmoved[name])
        difference = (moved[0][name] - moved[1][name]) / (2 * e)
        scale = 1.0 + np.abs(difference).max()
        assert np.abs(difference - changes[name]).max() < 5e-6 * scale
        assert np.abs(changes[name]).max() > 1e-3
    again, pull = kernel.vjp(start, OUTPUTS, steps=STEPS, n_envs=N, inputs=inputs)
    weights = alike(plain, rng)
    gradients = pull(weights)
    assert all(np.array_equal(again[name], plain[name]) for name in OUTPUTS)
    forward = sum(float(np.sum(weights[n] * changes[n])) for n in OUTPUTS)
    back = sum(float(np.sum(gradients[n] * tangents[n])) for n in tangents)
    assert back == pytest.approx(forward, rel=1e-11)
    assert {n: g.shape for n, g in gradients.items()} == {n: t.shape for n, t in tangents.items()}


def test_tangents_are_finite_differences_and_adjoints_their_transposes(kernel: Kernel) -> None:
    check(kernel, np.random.default_rng(3))


def test_they_are_where_a_member_is_seen_early(kernel: Kernel) -> None:
    plan = flatten(closed())
    order = tuple(plan.components.index(c) for c in plan.components)
    early = replace(plan, groups=(Group("gauss-seidel", order[::-1]),))
    check(Kernel(fused_of(early), 4, np.dtype(np.float64), False), np.random.default_rng(4))


def test_steps_made_twice_give_the_same_gradient(kernel: Kernel) -> None:
    start, inputs = given(np.random.default_rng(5))
    found = []
    for room in (1 << 29, 0):
        seen, pull = kernel.vjp(
            start, ["hull.eta"], steps=STEPS, n_envs=N, inputs=inputs, kept_bytes=room
        )
        found.append(pull(seen))
    for name in found[0]:
        assert np.array_equal(found[0][name], found[1][name])


def test_threads_give_the_same_gradient(kernel: Kernel) -> None:
    start = {"hull.nu_0": np.random.default_rng(6).standard_normal((9, 6))}
    found = []
    for threads in (1, 2):
        seen, pull = kernel.vjp(start, ["hull.eta"], steps=5, n_envs=9, threads=threads)
        found.append(pull(seen)["hull.nu_0"])
    assert np.array_equal(found[0], found[1])


def test_torch_finds_the_gradients_right(kernel: Kernel) -> None:
    start, inputs = given(np.random.default_rng(7))
    nu_0 = torch.tensor(start["hull.nu_0"][:2], requires_grad=True)
    wanted = torch.tensor(inputs["controller.eta_d"][:3, :2], requires_grad=True)

    def eta(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
        found = through_torch.rollout(
            kernel,
            {"hull.nu_0": a, "hull.eta_0": start["hull.eta_0"][:2]},
            ["hull.eta", "controller.tau_d"],
            steps=3,
            n_envs=2,
            inputs={"controller.eta_d": b},
        )
        return torch.cat([found["hull.eta"], found["controller.tau_d"]], dim=-1)

    assert torch.autograd.gradcheck(eta, (nu_0, wanted), eps=1e-6, atol=1e-6)


def test_a_gradient_step_reduces_the_error_of_a_trajectory(kernel: Kernel) -> None:
    target = torch.zeros(2, 6, dtype=torch.float64)
    target[:, 0], target[:, 2] = 0.3, 5.0
    nu_0 = torch.zeros(2, 6, dtype=torch.float32, requires_grad=True)
    eta_0 = np.tile([0.0, 0.1, 5.0, 0.0, 0.0, 0.0], (2, 1))
    errors = []
    for _ in range(3):
        start = {"hull.nu_0": nu_0, "hull.eta_0": eta_0, "controller.eta_d": eta_0}
        seen = through_torch.rollout(kernel, start, ["hull.eta"], steps=40, n_envs=2)
        error = ((seen["hull.eta"][-1] - target) ** 2).sum()
        errors.append(float(error.detach()))
        (gradient,) = torch.autograd.grad(error, nu_0)
        assert gradient.dtype == torch.float32
        nu_0 = (nu_0 - gradient).detach().requires_grad_()
    assert errors[0] > errors[1] > errors[2]


def test_without_a_gradient_nothing_is_compiled(kernel: Kernel) -> None:
    fresh = Kernel(kernel.fused, 4, np.dtype(np.float64), False)
    seen = through_torch.rollout(fresh, {"hull.m": 13.0}, ["hull.eta"], steps=2)
    assert seen["hull.eta"].shape == (2, 1, 6)
    assert fresh not in _compiled


def test_without_torch_one_sentence_says_which_extra(
    kernel: Kernel, monkeypatch: pytest.MonkeyPatch
) -> None:
    through_torch._through.cache_clear()
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(InputInvalid, match=r"uuvsim-cosim\[rl\]"):
        through_torch.rollout(kernel, {}, ["hull.eta"], steps=1)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"outputs": ["pressure.valid"]}, "pressure.valid: is Boolean, without derivatives"),
        ({"outputs": ["hull.etta"]}, "no variable 'hull.etta'; expected one such as hull.eta"),
        ({"tangents": {"hull.nu_0": np.zeros(6)}}, "hull.nu_0: was not given to the rollout"),
        ({"tangents": {"hull.m": np.zeros(2)}}, r"hull.m: tangent of shape \(2,\); expected \(\)"),
        ({"tangents": {"pressure.seed": [0, 1]}, "start": {"pressure.seed": [0, 1]}}, "is Int32"),
        ({"steps": 0}, "0 steps; expected at least 1"),
        ({"inputs": {"hull.v_c": np.zeros((2, 2, 3))}}, r"expected \(4, 3\) or \(4, 1, 3\)"),
        ({"inputs": {"hull.m": np.zeros(4)}, "start": {}}, "hull.m: is parameter, in inputs"),
    ],
)
def test_what_has_no_derivative_is_said_by_name(
    kernel: Kernel, arguments: dict[str, Any], words: str
) -> None:
    usual: dict[str, Any] = {
        "start": {"hull.m": 13.5}, "tangents": {}, "outputs": ["hull.eta"], "steps": 4,
    }  # fmt: skip
    with pytest.raises(InputInvalid, match=words):
        kernel.jvp(**{**usual, **arguments})


def test_a_gradient_of_another_shape_is_refused(kernel: Kernel) -> None:
    _, pull = kernel.vjp({"hull.m": 13.5}, ["hull.eta"], steps=2)
    with pytest.raises(InputInvalid, match=r"gradient of shape \(6,\); expected \(2, 1, 6\)"):
        pull({"hull.eta": np.zeros(6)})
    with pytest.raises(InputInvalid, match=r"hull.nu: is no output of the rollout"):
        pull({"hull.nu": np.zeros((2, 1, 6))})


def test_slower_components_and_single_precision_are_refused_by_name() -> None:
    system = closed().replace("pressure", "model:pressure", rate="0.02")
    with pytest.raises(SystemInvalid, match="pressure") as caught:
        fuse(system, lanes=4).jvp({}, {}, ["hull.eta"], steps=1)
    assert "a communication step longer than the system's" in str(caught.value)
