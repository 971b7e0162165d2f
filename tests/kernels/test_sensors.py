"""The sensors, with their options on, in a kernel: the master's bits, and snapshots that repeat."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from uuvsim_cosim.kernels import Kernel, fuse
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.system.system import System

STEPS = 400  # 4 s
N_ENVS = 3
SEEDS = [3, 14, 159]
SENSORS = {  # what the survey has is held there: compass, usbl, the plain imu and dvl
    "imu": ("model:imu@stim300", "eta q nu nu_dot"),
    "dvl": ("model:dvl@a50?period=0.01&track=both&aperiodic=true", "eta q nu"),
    "pressure": ("model:pressure@bar30", "eta q"),
    "magnetometer": ("model:magnetometer", "q"),
    "gps": ("model:gps", "eta q nu"),
    "lbl": ("model:lbl", "eta q"),
    "altimeter": ("model:altimeter", "eta q"),
    "leak": ("model:leak", "eta q"),
}


def everything() -> System:
    """A sphere that drifts and turns just under the surface, and all that can watch it."""
    system = System("everything", "0.01", "All sensors on one hull").add(
        "hull",
        "model:sphere",
        {"eta_0": (3, -2, 0.1, 0.2, -0.1, 1.0), "nu_0": (0.8, 0.2, -0.1, 0.3, 0.2, 0.5)},
    )
    for name, (source, observed) in SENSORS.items():
        start = {"leak": {"A_hole": 1e-5}, "gps": {"reacquisition": 0.0}}.get(name, {})
        system = system.add(name, source, start)
        for signal in observed.split():
            system = system.connect(f"hull.{signal}", f"{name}.{signal}")
    system = (
        system.add("radio", "model:modem?id=pool_radio&nodes=3&interval=0.1&publish_period=0.02")
        .add("positioning", "model:link?id=pool_positioning")
        .set("radio.slot", (0.0, 1.0, 1.0))
        .set("radio.position_2", (2.0, 0.0, 0.0))
        .set("radio.position_3", (0.0, 3.0, 0.0))
    )
    for k in (1, 2, 3):
        for target in (f"radio.position_1[{k}]", f"radio.x_1[{k}]", f"positioning.x[{k}]"):
            system = system.connect(f"hull.eta[{k}]", target)
    return system


@cache
def by_master() -> np.ndarray:
    plan = flatten(everything())
    instantiate = prepare(plan, "native")
    rows = []
    for seed in SEEDS:
        with Master(plan, instantiate) as master:
            master.initialize()
            master.reset(seed=seed)
            blocks = [
                c._block[c.description.of("output")[0].value_references[0] :]  # type: ignore[attr-defined]
                for c in master.components
            ]
            mine = []
            for _ in range(STEPS):
                master.step()
                mine.append(np.concatenate(blocks))
            rows.append(mine)
    return np.array(rows)


@pytest.fixture(scope="module")
def kernel() -> Kernel:
    return fuse(everything())


def names_of(kernel: Kernel) -> list[str]:
    plan = kernel.fused.plan
    return [f"{c.path}.{v.name}" for c in plan.components for v in c.description.of("output")]


def test_all_sensors_in_a_kernel_have_the_bits_of_a_master_of_their_own(kernel: Kernel) -> None:
    wanted, names = by_master(), names_of(kernel)
    with kernel.batch(N_ENVS, seeds=SEEDS) as batch:
        for k in range(STEPS):
            batch.step()
            seen = [batch.get(n).reshape(N_ENVS, -1).astype(float) for n in names]
            np.testing.assert_array_equal(np.hstack(seen), wanted[:, k])
        for sensor in ("dvl", "gps", "altimeter", "radio"):
            sampled = "t_sample_2" if sensor == "radio" else "t_sample"
            assert (batch.get(f"{sensor}.{sampled}") >= 0.0).any(), f"{sensor} never read anything"
        assert batch.get("lbl.valid").any()


def test_sensors_go_on_from_a_snapshot_as_if_nothing_had_happened() -> None:
    plan = flatten(everything())
    with Master(plan, prepare(plan, "native")) as master:
        master.initialize()
        master.reset(seed=5)
        master.step(137)
        held = master.snapshot()

        def rest() -> np.ndarray:
            master.step(100)
            return np.concatenate(
                [
                    np.ravel(master.get(c.path, v.name)).astype(float)
                    for c in plan.components
                    for v in c.description.of("output")
                ]
            )

        first = rest()
        master.restore(held)
        np.testing.assert_array_equal(rest(), first)


def test_another_seed_changes_every_noisy_reading() -> None:
    rows = by_master()[:, -1]
    assert np.mean(rows[0] != rows[1]) > 0.2
