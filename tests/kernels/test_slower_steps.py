"""Components with communication steps of their own: a kernel shows what the master shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.kernels import fuse
from uuvsim_cosim.kernels.codegen.fusible import fused_of
from uuvsim_cosim.kernels.kernel import Kernel
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Group, Plan

STEPS = 160


def slower(rates: dict[str, str]) -> uuv.System:
    system = uuv.load("bluerov2_survey")
    for path, rate in rates.items():
        source = system.components[path].source
        assert isinstance(source, str)
        system = system.replace(path, source, rate=rate)
    return system


def outputs_of(plan: Plan) -> list[str]:
    return [f"{c.path}.{v.name}" for c in plan.components for v in c.description.of("output")]


def agree(plan: Plan, kernel: Kernel) -> None:
    """Environments that begin at different times, each beside the master."""
    names = outputs_of(plan)
    rows = []
    seen = [(n.rsplit(".", 1)[0], n.rsplit(".", 1)[1]) for n in names]
    with Master(plan, prepare(plan, "native"), live=seen) as master:  # visible values
        master.initialize()
        master.reset(seed=5)
        for _ in range(STEPS + 1):
            rows.append(np.concatenate([np.ravel(master.get(*n)) for n in seen]))
            master.step()
    wanted = np.array(rows, float)
    batch = kernel.batch(5, seeds=[5] * 5)
    for k in range(STEPS):
        due = np.array([0, 3, 7, 21, 40]) == k
        if due.any():
            batch.reset(due)
        got = np.hstack([batch.get(n).reshape(5, -1).astype(float) for n in names])
        np.testing.assert_array_equal(got, wanted[batch.tick])
        batch.step()


@pytest.mark.parametrize(
    "rates",
    [
        {"controller": "0.04"},
        {"hull": "0.02", "battery": "0.05"},
        {"imu": "0.02", "dvl": "0.2", "navigation": "0.1", "usbl": "0.5", "thruster_2": "0.03"},
        {"guidance": "0.1", "allocation": "0.02", "thruster_3": "0.04", "thruster_4": "0.04"},
    ],
)
def test_a_longer_communication_step_is_seen_at_its_end(rates: dict[str, str]) -> None:
    system = slower(rates)
    agree(flatten(system), fuse(system))


def test_a_gauss_seidel_group_of_several_rates_sees_what_is_due() -> None:
    system = slower({"hull": "0.02", "wrench": "0.02", "allocation": "0.04", "thruster_5": "0.03"})
    plan = flatten(system)
    order = tuple(range(len(plan.components)))
    plan = replace(plan, groups=(Group("gauss-seidel", order),))
    agree(plan, Kernel(fused_of(plan), 8, np.dtype(np.float64), False))
