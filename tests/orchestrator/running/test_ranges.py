"""A run reports an output that leaves the range of an input that it feeds."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal

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
    assert not reported or "beyond the range [12, 16.8] V of t.voltage;" in found[0]


@pytest.mark.parametrize("backend", ["native", "fmu"])
def test_a_battery_that_sags_below_the_bench_rows_is_reported_with_time_and_value(
    backend: Literal["native", "fmu"], tmp_path: Path
) -> None:
    """It has 12.26 V at no current; its inner resistance and the full command lower that."""
    system = supplied("t200", soc_0=0.01)
    done = uuv.run(system, until=1, out=tmp_path / "r", backend=backend)
    [found] = [w for w in done.warnings if w.startswith("battery.voltage")]
    assert re.match(
        r"battery.voltage was 11\.75\d* V, from t = 0.04 s on beyond the range \[12, 16.8\]", found
    ), found


def test_below_the_bench_rows_each_way_to_run_computes_the_same_bits(tmp_path: Path) -> None:
    system = supplied("t200", soc_0=0.01)
    backends: tuple[Literal["native", "fmu"], ...] = ("native", "fmu")
    thrust = [
        uuv.run(system, until=1, out=tmp_path / b, backend=b).signals()["t.thrust"]
        for b in backends
    ]
    with uuv.fuse(system).batch(1) as batch:
        of_kernel = [float(batch.get("t.thrust")[0])]
        for _ in range(100):
            batch.step(1)
            of_kernel.append(float(batch.get("t.thrust")[0]))
    assert thrust[0].tolist() == thrust[1].tolist() == of_kernel


@pytest.mark.parametrize("volts", [11, 18])
def test_a_voltage_beyond_the_rows_is_refused_where_it_is_set(volts: float) -> None:
    with pytest.raises(uuv.UuvsimError, match=rf"{volts} V is out of range.*\[12, 16.8\] V"):
        uuv.System("one", "0.01").add("t", "model:thruster_t200", start={"voltage": volts})


def test_a_battery_that_begins_beyond_the_rows_is_refused(tmp_path: Path) -> None:
    with pytest.raises(uuv.UuvsimError, match=r"t.voltage: value 18.9"):
        uuv.run(supplied("t200", n_cells=4.5), until=0.1, out=tmp_path / "r", backend="native")


def test_a_voltage_that_is_refused_at_the_start_names_its_unit_and_its_source(
    tmp_path: Path,
) -> None:
    with pytest.raises(
        uuv.UuvsimError, match=r"t\.voltage: value 21\.0; .* V; battery\.voltage gives"
    ):
        uuv.run(supplied("t200", n_cells=5), until=1, out=tmp_path / "r", backend="native")
