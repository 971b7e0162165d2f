"""float32 kernels: near the float64 ones, with the same times, samples, seeds and failures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.errors import ComponentFailed, InputInvalid
from uuvsim_cosim.kernels import Kernel, fuse

N_ENVS = 21
SEEDS = [11 + 7 * e for e in range(N_ENVS)]
# Largest difference of float32 from float64 in the first 5 s. With sensors: a reading that is
# quantised may fall on the next step, 1 cm of depth, and the loop answers to it.
NEAR = {
    "bluerov2_hold": {"hull.eta": 2e-3, "hull.nu": 1e-2, "controller.tau_d": 0.1},
    "bluerov2_survey": {
        "hull.eta": 2e-2,  # m and rad
        "hull.nu": 5e-2,
        "navigation.eta": 2e-2,
        "battery.voltage": 2e-2,
    },
}


def start() -> dict[str, Any]:
    e = np.arange(N_ENVS)
    eta_0 = np.zeros((N_ENVS, 6))
    eta_0[:, 1], eta_0[:, 2], eta_0[:, 5] = 0.1 * e, 1 + 0.05 * e, 0.02 * e
    return {"hull.eta_0": eta_0, "hull.m": 13.4 + 0.02 * e, "guidance.speed": 0.3 + 0.03 * e}


@pytest.fixture(scope="module", params=["bluerov2_hold", "bluerov2_survey"])
def both(request: pytest.FixtureRequest) -> tuple[Kernel, Kernel]:
    system = uuv.load(request.param)
    return fuse(system), fuse(system, dtype="float32")


def test_a_float32_system_stays_near_the_float64_one(both: tuple[Kernel, Kernel]) -> None:
    double, single = (k.batch(N_ENVS, seeds=SEEDS, start=start(), threads=2) for k in both)
    near = NEAR["bluerov2_survey" if "navigation.eta" in double.variables else "bluerov2_hold"]
    worst = dict.fromkeys(near, 0.0)
    for _ in range(50):
        double.step(10)
        single.step(10)
        for name in near:
            got = single.get(name)
            assert got.dtype == np.float32
            worst[name] = max(worst[name], float(np.abs(double.get(name) - got).max()))
    assert all(worst[n] <= near[n] for n in near), worst
    assert np.ptp(single.get("hull.eta")[:, 1]) > 0.3  # environments differ


def test_time_does_not_drift_in_float32(both: tuple[Kernel, Kernel]) -> None:
    batch = both[1].batch(3)
    batch.step(20_001)
    assert batch.time.dtype == np.float64
    np.testing.assert_array_equal(batch.time, 20_001 / 100)
    np.testing.assert_array_equal(batch.tick, 20_001)


def test_float32_draws_are_the_float64_ones_rounded() -> None:
    """White noise about a constant: what differs is the rounding of the sum."""
    system = uuv.System("alone", "0.01").add("sensor", "model:pressure")
    seeds = [5, 6, 2**40]
    double = fuse(system).batch(3, seeds=seeds)
    single = fuse(system, dtype="float32").batch(3, seeds=seeds)
    outputs = [n for n, v in double.variables.items() if v.causality == "output"]
    for _ in range(30):
        double.step(10)
        single.step(10)
        for name in outputs:
            np.testing.assert_allclose(single.get(name), double.get(name), rtol=2e-6, atol=1e-6)
    noisy = [n for n in outputs if double.get(n).dtype == float and np.ptp(double.get(n)) > 0]
    assert noisy


@pytest.mark.parametrize("lanes", [4, 8, 32])
def test_every_width_is_near_the_others(lanes: int) -> None:
    system = uuv.load("bluerov2_hold")
    few = fuse(system, dtype="float32", lanes=lanes).batch(N_ENVS, seeds=SEEDS, start=start())
    usual = fuse(system, dtype="float32").batch(N_ENVS, seeds=SEEDS, start=start())
    few.step(200)
    usual.step(200)
    np.testing.assert_allclose(few.get("hull.eta"), usual.get("hull.eta"), atol=1e-4)


def test_environments_reset_apart_repeat_themselves(both: tuple[Kernel, Kernel]) -> None:
    whole, parts = (both[1].batch(N_ENVS, seeds=SEEDS, start=start()) for _ in range(2))
    parts.step(33)
    mask = np.arange(N_ENVS) % 3 == 1
    parts.reset(mask)
    whole.step(40)
    parts.step(40)
    np.testing.assert_array_equal(parts.tick, np.where(mask, 40, 73))
    np.testing.assert_array_equal(parts.get("hull.eta")[mask], whole.get("hull.eta")[mask])


def test_a_float32_failure_names_component_time_and_environment(
    both: tuple[Kernel, Kernel],
) -> None:
    batch, whole = (both[1].batch(N_ENVS, seeds=SEEDS, start=start()) for _ in range(2))
    nu_0 = np.zeros((N_ENVS, 6))
    nu_0[17] = 1e30  # its square is infinite in float32
    batch.reset(np.arange(N_ENVS) == 17, start={"hull.nu_0": nu_0}, check=False)
    whole.step(10)
    with pytest.raises(ComponentFailed, match=r"'hull' failed at t = 0 s.*environment 17"):
        batch.step(10)
    assert np.flatnonzero(batch.failed).tolist() == [17]
    others = np.arange(N_ENVS) != 17
    ends = batch.get("hull.eta")[others], whole.get("hull.eta")[others]
    np.testing.assert_array_equal(*ends)
    with pytest.raises(InputInvalid, match=r"hull\.m: value 1e\+200"):
        batch.set("hull.m", 1e200)
