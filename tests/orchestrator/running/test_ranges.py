"""A run reports an output that leaves the range of an input that it feeds."""

from __future__ import annotations

from pathlib import Path

import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.orchestrator.scenarios.scenario import Change, Scenario


def supplied(bench: str, **battery: float) -> uuv.System:
    """A T200 at full command on a battery."""
    return (
        uuv.System("supplied", "0.01")
        .add("battery", "model:battery", start=battery)
        .add("t", f"model:thruster_t200?bench={bench}", start={"u": 1.0})
        .connect("battery.voltage", "t.voltage")
        .connect("t.current", "battery.current")
    )


@pytest.mark.parametrize(
    ("bench", "cells", "reported"),
    [("t200", 3.9, False), ("t200", 4.5, True), ("t200_10_20v", 4.5, False)],
)
def test_a_voltage_that_leaves_the_bench_rows_is_reported(
    bench: str, cells: float, reported: bool, tmp_path: Path
) -> None:
    """The pack has four cells; at 0.3 s it gets another number."""
    more = Scenario("more", (Change(0.3, "battery.n_cells", cells),))
    system = supplied(bench)
    done = uuv.run(system, until=1, out=tmp_path / "r", backend="native", scenario=more)
    found = [w for w in done.warnings if w.startswith("battery.voltage")]
    assert bool(found) == reported, done.warnings
    assert not reported or "beyond the range [0, 16.8] V of t.voltage;" in found[0]


def test_a_voltage_beyond_the_rows_is_refused_where_it_is_set() -> None:
    with pytest.raises(uuv.UuvsimError, match=r"18 V is out of range.*\[0, 16.8\] V"):
        uuv.System("one", "0.01").add("t", "model:thruster_t200", start={"voltage": 18.0})


def test_a_battery_that_begins_beyond_the_rows_is_refused(tmp_path: Path) -> None:
    with pytest.raises(uuv.UuvsimError, match=r"t.voltage: value 18.9"):
        uuv.run(supplied("t200", n_cells=4.5), until=0.1, out=tmp_path / "r", backend="native")
