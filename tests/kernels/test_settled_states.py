"""States that decay reach zero instead of subnormal numbers, which slow down every later step."""

from __future__ import annotations

import numpy as np

import uuvsim_cosim as uuv
from uuvsim_cosim.kernels import fuse
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.system.sources import Backend

SYSTEM = uuv.System("bench", tick="0.01").add("thruster", "model:thruster")
STRIDE, STRIDES = 20, 120  # 24 s: 836 time constants of the shaft


def shaft_of_master(backend: Backend) -> np.ndarray:
    """Return the shaft speeds of a thruster after its command went from 1 to 0."""
    plan = flatten(SYSTEM)
    speeds = []
    with Master(plan, prepare(plan, backend), held=[("thruster", "u")]) as master:
        master.initialize()
        for command in (1.0, *STRIDES * [0.0]):
            master.set("thruster", "u", command)
            master.step(STRIDE)
            speeds.append(master.get("thruster", "n"))
    return np.array(speeds)


def shaft_of_kernel(dtype: str) -> np.ndarray:
    batch = fuse(SYSTEM, dtype=dtype).batch(3)
    speeds = []
    for command in (1.0, *STRIDES * [0.0]):
        batch.set("thruster.u", command)
        batch.step(STRIDE)
        speeds.append(batch.get("thruster.n")[1])
    return np.array(speeds)


def test_a_shaft_that_runs_down_stops_with_the_same_bits_as_fmu_native_and_kernel() -> None:
    fmu = shaft_of_master("fmu")
    np.testing.assert_array_equal(shaft_of_master("native"), fmu)
    np.testing.assert_array_equal(shaft_of_kernel("float64"), fmu)
    assert fmu[0] > 300.0
    assert np.any((fmu > 0.0) & (fmu < 1e-250))  # it decays by its equation until it is tiny
    assert fmu[-1] == 0.0
    assert not np.any((fmu != 0.0) & (np.abs(fmu) < np.finfo(float).tiny))


def test_a_shaft_of_a_float32_kernel_stops_before_it_is_subnormal() -> None:
    speeds = shaft_of_kernel("float32")
    assert speeds[-1] == 0.0
    assert not np.any((speeds != 0.0) & (np.abs(speeds) < np.finfo(np.float32).tiny))
