"""A CAN bus after FMI-LS-BUS: frames, arbitration and errors between FMUs, by clocks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import uuvsim_cosim as uuv
from tests.conftest import FOREIGN, foreign_fmu
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten

BAUD = 100_000
FRAME = (47 + 8 * 4) / BAUD  # s, of 4 bytes
COUNTS = ("sent", "received", "confirmed", "lost", "errors", "last_id", "last_at")


@pytest.fixture
def can(tmp_path: Path) -> Any:
    """Return a system of two nodes and a bus, whose terminals are connected crosswise."""
    source = FOREIGN / "clocks" / "can_fmi3.c"
    node, bus = (
        str(foreign_fmu("can", tmp_path, source=source, xml=source.with_name(f"can_{role}.xml")))
        for role in ("node", "bus")
    )

    def build(n1: dict[str, float], n2: dict[str, float], tick: str, error_at: int = 0) -> Any:
        system = uuv.System("can", tick).add("n1", node, n1).add("n2", node, n2)
        system = system.add("bus", bus, {"error_at": error_at})
        for i in (1, 2):
            for what in ("Clock", "Data"):
                system = system.connect(f"n{i}.Tx_{what}", f"bus.Node{i}.Rx_{what}")
                system = system.connect(f"bus.Node{i}.Tx_{what}", f"n{i}.Rx_{what}")
        return system

    return build


def counts(system: uuv.System, until: float) -> tuple[list[dict[str, Any]], list[Any]]:
    plan = flatten(system.with_events())
    with Master(plan, prepare(plan)) as master:
        master.initialize()
        master.run_until(until)
        found = [{n: master.get(c, n) for n in COUNTS} for c in ("n1", "n2")]
        return found, master.events


@pytest.mark.parametrize("tick", ["0.001", "0.01", "0.003"])
def test_a_frame_arrives_when_its_bits_are_sent(tick: str, can: Any) -> None:
    """Node 1 sends at 10.5, 20.5, … ms, in the middle of a step, and node 2 hears it later."""
    (one, two), events = counts(can({"first": 0.0105}, {"period": 0}, tick), 0.099)
    assert (one["sent"], one["confirmed"], one["received"]) == (9, 9, 0)
    assert (two["received"], two["last_id"]) == (9, 1)
    heard = [e.time for e in events if (e.component, e.cause) == ("n2", "clock Rx_Clock")]
    assert heard == pytest.approx([0.0105 + 0.01 * k + FRAME for k in range(9)], abs=1e-12)
    assert two["last_at"] == pytest.approx(heard[-1], abs=1e-12)


def test_the_frame_with_the_lower_id_is_sent_first(can: Any) -> None:
    """Both want to send at 10 ms: ID 2 waits until ID 1 is through, and arrives a frame later."""
    (one, two), _ = counts(can({"id": 2}, {"id": 1}, "0.001"), 0.0199)
    assert one["last_at"] == pytest.approx(0.01 + FRAME, abs=1e-12)
    assert two["last_at"] == pytest.approx(0.01 + 2 * FRAME, abs=1e-12)
    assert (one["last_id"], two["last_id"]) == (1, 2)
    assert (one["lost"], two["lost"]) == (0, 0)


def test_a_node_that_discards_is_told_that_it_lost_arbitration(can: Any) -> None:
    (one, two), _ = counts(can({"id": 2, "discards": 1}, {"id": 1}, "0.001"), 0.0199)
    assert (one["lost"], one["confirmed"], one["received"]) == (1, 0, 1)
    assert (two["confirmed"], two["received"]) == (1, 0)


def test_a_bus_error_reaches_both_nodes_and_no_frame_does(can: Any) -> None:
    (one, two), _ = counts(can({}, {"period": 0}, "0.001", error_at=2), 0.0399)
    assert (one["errors"], one["confirmed"]) == (1, 2)
    assert (two["errors"], two["received"]) == (1, 2)


def test_nothing_is_sent_between_nodes_of_unequal_baud_rates(can: Any) -> None:
    (one, two), _ = counts(can({}, {"period": 0, "baud": 2 * BAUD}, "0.001"), 0.05)
    assert (one["sent"], one["confirmed"], two["received"]) == (5, 0, 0)
