"""Scenarios in WebAssembly: the faults and changes of the master, bit for bit."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest

import uuvsim_cosim as uuv
from tests.kernels.web_assembly.test_module import Kept
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.kernels.web_assembly.module import web_assembly
from uuvsim_cosim.kernels.web_assembly.node import NodeRun, run_in_node
from uuvsim_cosim.orchestrator.master.faults import Fault, FaultKind
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.scenarios.played import Played
from uuvsim_cosim.orchestrator.scenarios.scenario import (
    Change,
    Event,
    Manipulation,
    Scenario,
    SignalFault,
)
from uuvsim_cosim.orchestrator.system.sources import Backend

STEPS = 300
pytestmark = pytest.mark.skipif(shutil.which("node") is None, reason="no node on this machine")


def fault(at: float, until: float, signal: str, kind: FaultKind, value: float = 0.0) -> SignalFault:
    return SignalFault(at, Fault(signal, kind, value), until)


def played(
    system: uuv.System, *events: Event, seed: int = 3, backend: Backend = "native"
) -> tuple[np.ndarray, NodeRun]:
    """Return the rows of the master and the run in node with the same scenario."""
    scenario, plan, kept = Scenario("test", events), flatten(system, seed=seed), Kept()
    with Master(plan, prepare(plan, backend), observers=[kept]) as master:
        master.initialize()
        Played(master, scenario).step(STEPS)
    found = run_in_node(web_assembly(system), STEPS, seed=seed, scenario=scenario)
    return np.concatenate(kept.parts), found


def same_bits(rows: np.ndarray, found: NodeRun) -> None:
    assert found.failure == ""
    np.testing.assert_array_equal(found.rows.view(np.uint64), rows.view(np.uint64))


END = float("inf")


@pytest.mark.parametrize("backend", ["native", "fmu"])
def test_all_kinds_of_faults_and_changes_have_the_master_s_bits(backend: Backend) -> None:
    rows, found = played(
        uuv.load("bluerov2_survey"),
        fault(0, END, "compass.psi", "bias", 0.1),
        fault(1, 2, "dvl.t_sample", "drop", 0.5),
        fault(0.5, 3, "dvl.beam_velocity", "drop", 0.3),
        fault(1, 2, "navigation.eta[3]", "freeze"),
        fault(2, 4, "navigation.eta", "delay", 0.1),
        fault(0.3, END, "guidance.done", "override", 1),
        fault(0.4, 2.5, "guidance.waypoint", "bias", 1),
        fault(1.5, END, "hull.nu_r[1]", "scale", 1.2),
        fault(2.2, 2.6, "thruster_3.thrust", "override", 2.0),
        fault(1, END, "controller.tau_d", "drop", 0.5),
        Change(2.0, "guidance.speed", "0.3 m/s"),
        Change(2.5, "allocation.health[3]", 0.2),
        Change(1, "guidance.waypoints[2,1]", 7.5),
        Manipulation(1.0, "allocation.health[1]", "override", 0.5, 2.0),
        backend=backend,
    )
    same_bits(rows, found)


@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize("kind", ["drop", "delay", "freeze", "bias"])
def test_a_fault_of_a_component_with_a_longer_step_acts_where_its_outputs_become_visible(
    algorithm: str, kind: FaultKind
) -> None:
    system = (
        uuv.System("slow", tick="0.01")
        .add("current", "model:current_gauss_markov", rate="0.05")
        .add("hull", "model:sphere", rate="0.05", start={"eta_0": [0.0, 0.0, 3.0, 0.0, 0.0, 0.0]})
        .add("compass", "model:compass", rate="0.1")
        .connect("current.v_c", "hull.v_c")
        .connect("hull.eta", "compass.eta")
    )
    if algorithm == "gauss-seidel":
        system = system.group(["current", "hull", "compass"])
    value = {"drop": 0.5, "delay": 0.1, "freeze": 0.0, "bias": 0.3}[kind]
    same_bits(
        *played(
            system,
            fault(0.2, 2.0, "current.v_c", kind, value),
            fault(0.33, END, "hull.eta", kind, value),
            fault(0.4, 2.4, "compass.psi", kind, value),
        )
    )


def test_several_faults_of_one_signal_act_one_after_another() -> None:
    first = fault(0.5, END, "hull.eta[3]", "bias", 1.0)
    second = fault(0.5, 2.0, "hull.eta[3]", "scale", 2.0)
    results = [
        played(uuv.load("bluerov2_hold"), *pair) for pair in ((first, second), (second, first))
    ]
    for rows, found in results:
        same_bits(rows, found)
    assert results[0][1].hash != results[1][1].hash


def test_the_seed_of_the_system_determines_which_samples_are_lost() -> None:
    lost = fault(0.1, END, "hull.eta", "drop", 0.5)
    system = uuv.load("bluerov2_hold")  # no other random numbers
    runs = [played(system, lost, seed=seed) for seed in (1, 2)]
    for rows, found in runs:
        same_bits(rows, found)
    assert runs[0][1].hash != runs[1][1].hash


def test_a_wrong_event_is_refused_with_the_master_s_message() -> None:
    compiled = web_assembly(uuv.load("bluerov2_hold"))
    for event, text in (
        (fault(1, 2, "hull.eta_", "bias", 1), "hull.eta_"),
        (fault(1, 2, "hull.eta", "delay", 0.005), "delay 0.005 s"),
        (Change(1, "hull.mass_", 3), "mass_"),
    ):
        with pytest.raises(InputInvalid, match=text):
            run_in_node(compiled, 10, scenario=Scenario("wrong", (event,)))


def test_more_faults_than_the_page_has_memory_for_end_the_run_with_a_message() -> None:
    compiled = web_assembly(uuv.load("bluerov2_hold"))
    each = fault(0.05, END, "hull.eta", "bias", 1e-9)
    many = Scenario("many", tuple(replace(each) for _ in range(22)))  # of 6 elements each
    found = run_in_node(compiled, 10, scenario=many)
    assert found.failure.startswith("There is no memory for so many faults")
    assert found.steps == 4
