"""Torpedo-shaped vehicles in a kernel: strips, lift, products, fins and propeller, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest

from uuvsim_cosim.kernels import fuse
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.system.system import System

STEPS = 400


def steered(vehicle: str, fins: int) -> System:
    rudder = [0.1, 0.1, 0.02, 0.02][:fins]
    return (
        System("steered", "0.02")
        .add("hull", f"model:{vehicle}", start={"nu_0": [1.2, 0.1, -0.1, 0, 0.02, 0]})
        .add("propeller", f"model:propeller?vehicle={vehicle}", start={"u": 0.6})
        .add("fins", f"model:fins?vehicle={vehicle}&contact=true", start={"u": rudder})
        .connect("propeller.tau", "fins.contact")
        .connect("fins.tau", "hull.tau")
        .connect("hull.nu_r", "propeller.nu_r")
        .connect("hull.nu_r", "fins.nu_r")
    )


@pytest.mark.parametrize(("vehicle", "fins"), [("npsauv", 4), ("remus100@fossen_2021", 4)])
def test_a_kernel_of_a_torpedo_is_its_master_bit_for_bit(vehicle: str, fins: int) -> None:
    system = steered(vehicle, fins)
    plan = flatten(system)
    with Master(plan, prepare(plan, "native")) as master:
        master.initialize()
        for _ in range(STEPS):
            master.step()
        expected = [np.asarray(master.get("hull", n)) for n in ("eta", "nu", "nu_dot")]
    with fuse(system).batch(5) as batch:
        batch.reset(seeds=list(range(5)))
        batch.step(STEPS)
        for name, value in zip(("eta", "nu", "nu_dot"), expected, strict=True):
            for lane in batch.get(f"hull.{name}"):
                np.testing.assert_array_equal(lane, value)
