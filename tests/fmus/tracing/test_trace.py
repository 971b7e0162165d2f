"""The trace of FMI calls: each is written with its arguments and status, and nothing changes."""

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from uuvsim_cosim.errors import ComponentFailed, InputInvalid
from uuvsim_cosim.fmus.check.simulate_fmu import simulate_fmu
from uuvsim_cosim.fmus.tracing.trace import Trace


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("version", [1, 2, 3])
def test_each_call_of_an_fmu_is_a_line(
    version: int, c_fmu: Callable[..., Path], tmp_path: Path
) -> None:
    fmu, file = c_fmu(version), tmp_path / "calls.csv"
    plain = simulate_fmu(fmu, until=1, step="0.5", start={"k": "2"}, inputs={"u": 0.25})
    with Trace(file) as trace:
        traced = simulate_fmu(
            fmu, until=1, step="0.5", start={"k": "2"}, inputs={"u": 0.25}, trace=trace
        )
    assert np.array_equal(traced["y"], plain["y"])
    calls = rows(file)
    prefix = "first_order_fmi" if version == 1 else f"fmi{version}"
    slave = "Slave" if version == 1 else ""
    functions = [c["function"] for c in calls]
    assert functions[0].startswith(f"{prefix}Instantiate")
    assert functions[-2:] == [f"{prefix}Terminate{slave}", f"{prefix}Free{slave}Instance"]
    assert functions.count(f"{prefix}DoStep") == 2
    assert {c["component"] for c in calls} == {"first_order"}
    real = "Float64" if version == 3 else "Real"
    arguments = [c["arguments"] for c in calls if c["function"] == f"{prefix}Set{real}"]
    assert {"k = 2.0", "u = 0.25"} <= set(arguments)
    y = [c["arguments"] for c in calls if c["arguments"].startswith("y = ")]
    y = y[::2] if version == 1 else y  # its negated alias reads the same value
    assert y == [f"y = {x!r}" for x in plain["y"].tolist()]
    steps = [c for c in calls if c["function"] == f"{prefix}DoStep"]
    assert [c["arguments"].split()[:2] for c in steps] == [["0.0", "0.5"], ["0.5", "0.5"]]
    assert {c["status"] for c in steps} == {"ok"}
    if version == 3:  # of each pointer, what the FMU has written there
        ends = [f"-> False -> False -> False -> {t}" for t in ("0.5", "1.0")]
        assert [c["arguments"].partition(" True ")[2] for c in steps] == ends
    assert all(float(c["took_us"]) >= 0 for c in calls)
    walls = [float(c["wall_s"]) for c in calls]
    assert walls == sorted(walls)


def test_a_failed_call_is_written_with_its_status(
    c_fmu: Callable[..., Path], tmp_path: Path
) -> None:
    file = tmp_path / "calls.csv"
    start = {"fault": "2", "fault_time": "0.1"}
    with Trace(file) as trace, pytest.raises(ComponentFailed):
        simulate_fmu(c_fmu(2), until=1, step="0.1", start=start, trace=trace)
    failed = [c for c in rows(file) if c["status"] not in ("ok", "instance", "")]
    assert [c["function"] for c in failed] == ["fmi2DoStep"]


def test_a_line_begins_before_its_call(tmp_path: Path) -> None:
    trace = Trace(tmp_path / "x.csv")
    trace.begin(0.1, "a", "fmi3DoStep")
    assert (tmp_path / "x.csv").read_text().splitlines()[1].endswith(",0.1,a,fmi3DoStep,")
    trace.close()


def test_a_trace_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match="cannot be written"):
        Trace(tmp_path / "no" / "x.csv")
