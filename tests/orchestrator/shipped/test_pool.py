"""The pool of figure 11: who knows what, and that a policy's pilot can be exchanged."""

from __future__ import annotations

import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.content import content
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.shipped.pool import PACKET, pool_tracking
from uuvsim_cosim.orchestrator.system.system import System

ON_BOARD = {"navigation", "predictor", "pilot", "allocation"}
OWN_SENSORS = {"imu", "compass"}


@pytest.fixture(scope="module")
def system() -> System:
    return uuv.load("pool_tracking")


def test_nothing_on_board_reads_the_truth(system: System) -> None:
    sources = {w.source.element for w in system.checked.wires if w.target.element in ON_BOARD}
    assert sources == (ON_BOARD - {"allocation"}) | OWN_SENSORS | {"radio"}


def test_the_radio_brings_what_the_station_saw_and_the_vehicle_sends_nothing(
    system: System,
) -> None:
    wires = {(str(w.source.element), str(w.target.element)) for w in system.checked.wires}
    assert ("positioning", "radio") in wires
    assert {a for a, b in wires if b == "positioning"} == {"hull", "quarry"}
    plan = flatten(system)
    (radio,) = [c for c in plan.components if c.path == "radio"]
    assert not radio.start["send_2"]
    seconds = PACKET["bits"] / 640.0 + PACKET["processing"]
    assert seconds == pytest.approx(0.4)


def test_any_policy_of_one_tracker_takes_the_pilots_place(system: System) -> None:
    file = content("models", "policies") / "source_sac.npz"
    other = system.replace("pilot", f"policy:{file}")
    fed = {w.target.variable.name: w.source.element for w in other.checked.wires
           if w.target.element == "pilot"}  # fmt: skip
    assert fed == {"eta": "navigation", "nu": "navigation", "target": "predictor"}


def test_a_plain_pilot_leaves_its_commands_free() -> None:
    plain = pool_tracking("model:pilot?vehicle=pool8&period=1/50")
    fed = {w.target.variable.name for w in plain.checked.wires if w.target.element == "pilot"}
    assert fed == {"eta", "nu"}
