"""MPC in a system: in process, compiled and as an FMU it gives the same; kernels refuse it."""

from __future__ import annotations

from threading import Thread

import numpy as np
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.errors import InputInvalid, SystemInvalid
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.kernels.codegen.fusible import fused_of
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten

IN_PROCESS = "uuvsim_cosim.models.control.mpc_in_process:MPC"


def flown(controller: str, steps: int = 250) -> np.ndarray:
    """Poses and wanted forces of `bluerov2_hold` in a current, and the last wanted pose."""
    current = uuv.load("bluerov2_hold").set("hull.v_c", (0.2, 0.1, 0))
    plan = flatten(current.replace("controller", controller))
    rows = []
    with Master(plan, prepare(plan, "native")) as master:
        master.initialize()
        for _ in range(steps):
            master.step()
            off = master.get("hull", "eta") - master.get("guidance", "eta_d")
            rows.append(np.concatenate([off, master.get("controller", "tau_d")]))
    return np.array(rows)


@pytest.fixture(scope="module")
def native() -> np.ndarray:
    return flown("mpc")


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_fmu_of_it_flies_to_the_same_bits(native: np.ndarray, fmi: int) -> None:
    np.testing.assert_array_equal(flown(str(build_fmu(uuv.declare("mpc"), fmi=fmi))), native)


def test_the_python_component_flies_the_same_within_1e_9(native: np.ndarray) -> None:
    np.testing.assert_allclose(flown(IN_PROCESS), native, atol=1e-9)


def test_it_bears_a_current_that_it_is_not_told_of(native: np.ndarray) -> None:
    assert np.linalg.norm(native[-1, :3]) < 0.1


def test_ipopt_which_goes_on_to_convergence_gives_nearly_the_same(native: np.ndarray) -> None:
    assert np.abs(flown("mpc_ipopt", 50) - native[:50]).max() < 0.05


def started(path: str) -> Native:
    component = Native(uuv.declare("mpc"), path)
    component.enter_initialization_mode(0.0, None)
    component.exit_initialization_mode()
    return component


def driven(component: Native, seed: int, into: dict[int, np.ndarray], scale: float = 0.3) -> None:
    rng = np.random.default_rng(seed)
    rows = []
    for k in range(20):
        for name in ("eta", "nu", "eta_d", "nu_d"):
            component.set(component.description.variables[name], rng.normal(0, scale, 6))
        component.do_step(0.1 * k, 0.1)
        v = component.description.variables
        rows.append([*component.get(v["tau_d"]), component.get(v["solved"])])
    into[seed] = np.array(rows)


def test_instances_in_two_threads_do_not_disturb_each_other() -> None:
    alone: dict[int, np.ndarray] = {}
    together: dict[int, np.ndarray] = {}
    for seed in (1, 2):
        driven(started("a"), seed, alone)
    threads = [Thread(target=driven, args=(started("b"), s, together)) for s in (1, 2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for seed in (1, 2):
        np.testing.assert_array_equal(together[seed], alone[seed])


def test_where_the_prediction_is_not_finite_the_last_plan_goes_on_and_it_is_said() -> None:
    rows: dict[int, np.ndarray] = {}
    driven(started("far"), 3, rows, 1e4)
    assert np.all(np.isfinite(rows[3]))
    assert not np.any(rows[3][:, -1])


def test_a_kernel_refuses_it_by_name() -> None:
    with pytest.raises(SystemInvalid, match="controller: an optimiser, model:mpc, in a kernel"):
        fused_of(flatten(uuv.load("bluerov2_hold").replace("controller", "mpc")))


def test_the_one_with_ipopt_is_no_declaration() -> None:
    with pytest.raises(InputInvalid, match="mpc_ipopt is no declaration but a Python component"):
        uuv.declare("mpc_ipopt")
